"""The corruptions that a model is tested under."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.corruptions.benchmark_corruption import Mode
from sextant.corruptions.contract import Images, Indices, Positions, require_indices
from sextant.corruptions.corruption import Corruption
from sextant.errors import ArgumentError
from sextant.ranges import Seed, checked


@dataclass(frozen=True)
class Protocol:
    """The facts about corrupted images that a report has to state.

    >>> from sextant.corruptions import BenchmarkSuite
    >>> protocol = BenchmarkSuite("cifar10_c", ["fog"], severities=[3]).protocol
    >>> protocol.severities, protocol.rounding
    ({'fog': (3,)}, '8 bits, fraction dropped')

    Attributes:
        set: which published set.
        title: its name and source.
        severities: those tested, by corruption, in the published order.
        mode: ``faithful`` to the authors' code, ``corrected``, or ``published``: files of the authors themselves.
        rounding: how images become 8 bits, as in the published files.
        baseline: errors by which corruption errors of the set are divided.
        image_size: size of the images that the set was published for.
        seed: seed of all random draws.
    """

    set: str
    title: str
    severities: Mapping[str, tuple[float, ...]]
    mode: Mode | Literal["published"]
    rounding: str
    baseline: str
    image_size: int
    seed: int

    def as_dict(self) -> dict[str, Any]:
        """The protocol as a dictionary, for a file of results."""
        return asdict(self)


#: images of bytes corrupted at a time
BATCH = 256


@dataclass(frozen=True)
class Condition:
    """One test condition: a corruption at a severity, or none (``clean``)."""

    corruption: str | None = None
    level: float | None = None

    @property
    def key(self) -> str:
        """Its name in metrics and files, such as ``clean`` or ``gaussian/0.1``."""
        return "clean" if self.corruption is None else f"{self.corruption}/{self.level:g}"


class CorruptionSuite:
    """The conditions of a test, and the images under each.

    Every run that uses the suite gets the same corrupted images: they depend on ``seed`` here, not on the run's seed,
    so that models are compared on the same images.

    >>> import torch
    >>> from sextant.corruptions import GaussianNoise
    >>> suite = CorruptionSuite({"gaussian": GaussianNoise([0.1, 0.2])})
    >>> [condition.key for condition in suite.conditions()]
    ['clean', 'gaussian/0.1', 'gaussian/0.2']
    >>> suite.corrupt(torch.zeros(2, 1, 28, 28), [0, 1], Condition("gaussian", 0.2)).shape
    torch.Size([2, 1, 28, 28])

    Args:
        corruptions: corruptions by name; the empty mapping tests clean images alone.
        seed: seed of all random draws.

    Attributes:
        protocol: the protocol of a published set; None for custom conditions.
    """

    protocol: Protocol | None = None

    @checked
    def __init__(self, corruptions: Mapping[str, Corruption[Any]] | None = None, seed: Seed = 0):
        self.corruptions = dict(corruptions or {})
        self.seed = seed

    def conditions(self) -> list[Condition]:
        """Clean first, then every corruption at each of its severities."""
        corrupted = [Condition(name, level) for name, c in self.corruptions.items() for level in c.levels]
        return [Condition(), *corrupted]

    def corrupt(self, images: Images, indices: Indices, condition: Condition) -> Images:
        """``images``, in [0, 1] and at positions ``indices`` of their dataset, under ``condition``.

        Raises:
            ArgumentError: the suite has no such corruption.
            ValueError: the corruption has no such level.
            UserError: as a :class:`.Corruption`.
        """
        if condition.corruption is None:
            return images
        level: Any = condition.level  # None is refused by the corruption
        return self._named(condition.corruption)(images, level, indices, self.seed)

    def _named(self, name: str) -> Corruption[Any]:
        if name not in self.corruptions:
            known = ", ".join(self.corruptions) or "none, only clean images"
            raise ArgumentError(f"corruption={name} is not in the suite", f"There are: {known}.")
        return self.corruptions[name]

    def corrupt_bytes(
        self, images: UInt8[ndarray, "n h w c"], indices: Int64[ndarray, "n"] | Indices, condition: Condition
    ) -> UInt8[ndarray, "n h w c"]:
        """Images of bytes under ``condition``, at their own size, rounded to the nearest byte.

        >>> from sextant.corruptions import BenchmarkSuite
        >>> grey = np.full((2, 64, 96, 3), 128, np.uint8)
        >>> BenchmarkSuite(names=["fog"]).corrupt_bytes(grey, np.arange(2), Condition("fog", 3)).shape
        (2, 64, 96, 3)

        Args:
            images: with one or three channels.
            indices: positions of the images in their dataset, which seed the draws.
            condition: one of :meth:`conditions`.

        Raises:
            ArgumentError: the images are of another kind, or the suite has no such corruption.
            UserError: there is not one index for each image; or as :meth:`corrupt`.
        """
        if not isinstance(images, ndarray) or images.dtype != np.uint8 or images.ndim != 4:
            kind, shape = getattr(images, "dtype", type(images).__name__), tuple(getattr(images, "shape", ()))
            problem = f"images are {kind} of the shape {shape}, not a NumPy array of uint8 (n, h, w, c)"
            raise ArgumentError(problem, "Give bytes from 0 to 255, and one image as a batch: images[None].")
        given: Any = indices.copy() if isinstance(indices, ndarray) else indices  # may be read-only or run backwards
        positions = require_indices(given, len(images))
        found = images.copy()
        if condition.corruption is None:
            return found
        for some in np.split(np.arange(len(images)), range(BATCH, len(images), BATCH)):
            clean = torch.from_numpy(images[some]).permute(0, 3, 1, 2).float() / 255
            now = self.corrupt(clean, positions[some], condition).clamp(0, 1)
            found[some] = (now * 255).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
        return found

    def check_labels(self, labels: Int64[Tensor, "b"], indices: Positions) -> None:
        """For stored images, raise a ``UserError`` if the images at ``indices`` cannot be those with ``labels``."""
