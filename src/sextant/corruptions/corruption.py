"""The interface of corruptions: parameters are drawn from a seed, then applied to a batch of images."""

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from numbers import Real
from typing import Generic, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.corruptions.contract import Images, Indices, Positions, require_images, require_indices, require_seed


def image_seeds(name: str, level: float, indices: Positions, seed: int) -> list[int]:
    """A 63-bit seed for each image: a hash of (seed, corruption, severity, image index)."""
    key = f"{seed}/{name}/{float(level)!r}/".encode()
    digests = (hashlib.blake2b(key + str(i).encode(), digest_size=8).digest() for i in indices.tolist())
    return [int.from_bytes(digest, "little") >> 1 for digest in digests]


def generators(seeds: list[int]) -> list[torch.Generator]:
    """One CPU generator per seed; draws are made on the CPU, so that every device gets the same corrupted image."""
    return [torch.Generator().manual_seed(seed) for seed in seeds]


def filled(
    shape: tuple[int, ...], streams: list[torch.Generator], fill: Callable[[Tensor, torch.Generator], object]
) -> Float[Tensor, "b ..."]:
    """Numbers of ``shape`` for each stream, which ``fill`` draws from it in place."""
    found = torch.empty(len(streams), *shape, dtype=torch.float32)
    for one, stream in zip(found, streams, strict=True):
        fill(one, stream)
    return found


Params = TypeVar("Params")


class Corruption(ABC, Generic[Params]):
    """A seeded, batched image corruption with a list of severities.

    The draw is separate from its application, so that the parameters of an image can be inspected and reused:
    ``corruption(images, level, indices, seed)`` equals ``apply(images, level, draw(level, indices, shape, seed))``,
    and every image depends only on (seed, corruption, level, its index), not on its batch. The call checks its
    arguments; ``draw`` and ``apply`` on their own do not.

    Attributes:
        name: enters the seeds; corruptions of one name share their random streams. Metrics use the suite's key.
        levels: the severities, in the corruption's own unit, mildest first.
    """

    name: str
    levels: Sequence[float]

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Params:
        """Random parameters for the images of a dataset at ``indices``, each of ``shape``; by default None."""
        return None  # type: ignore[return-value]

    @abstractmethod
    def apply(self, images: Images, level: float, params: Params) -> Images:
        """Corrupt ``images``, values in [0, 1], with drawn parameters."""

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless the corruption is defined at this level: by default at any finite number."""
        if isinstance(level, bool) or not isinstance(level, Real) or not math.isfinite(level):
            raise ValueError(f"a level of {self.name} is a finite number, not {level!r}")

    def __call__(self, images: Images, level: float, indices: Indices, seed: int) -> Images:
        """Draw and apply.

        Args:
            images: grey or colour, values in [0, 1]; a batch may be empty.
            level: severity, in the corruption's unit.
            indices: the images' positions in their dataset, one for each; may be a list, or a number for one image.
            seed: seed of all random draws.

        Returns:
            New images of the same shape and type.

        Raises:
            UserError: the images have another shape, type or range, or there are more or fewer indices than images.
            ValueError: the corruption has no such level.
        """
        require_images(images)
        self.check_level(level)
        positions, seed = require_indices(indices, len(images)), require_seed(seed)
        if len(images) == 0:
            return images.clone()
        return self.apply(images, level, self.draw(level, positions, tuple(images.shape[1:]), seed))
