"""What a corruption is: parameters drawn from a seed, then applied to a batch of images."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar

from jaxtyping import Float, Int64
from torch import Tensor

Params = TypeVar("Params")


class Corruption(ABC, Generic[Params]):
    """A seeded, batched image corruption with a list of severities.

    The draw is separate from its application, so that what happened to one image can be inspected and repeated:
    ``corruption(images, level, indices, seed)`` equals ``apply(images, level, draw(level, indices, shape, seed))``,
    and every image depends on (seed, corruption, level, its index) alone, not on its batch.

    Attributes:
        name: enters the seeds; corruptions of one name share their random streams. Metrics use the suite's key.
        levels: the severities, in the corruption's own unit, mildest first.
    """

    name: str
    levels: Sequence[float]

    @abstractmethod
    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> Params:
        """Random parameters for the images of a dataset at ``indices``, each of ``shape``."""

    @abstractmethod
    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: Params) -> Float[Tensor, "b c h w"]:
        """Corrupt ``images``, values in [0, 1], with drawn parameters."""

    def __call__(
        self, images: Float[Tensor, "b c h w"], level: float, indices: Int64[Tensor, "b"], seed: int
    ) -> Float[Tensor, "b c h w"]:
        """Draw and apply."""
        return self.apply(images, level, self.draw(level, indices, tuple(images.shape[1:]), seed))
