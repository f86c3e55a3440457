"""Representations of images, computed once for all methods."""

from collections.abc import Callable

from jaxtyping import Float, UInt8
from torch import Tensor

from sextant.chapters.cosfire.methods import Representation


class SeenImages(dict[Representation, Float[Tensor, "n d"]]):
    """Representations of images by kind; each is computed on first use and kept.

    Args:
        images: bytes, on the CPU.
        represent: computes a kind of representation, possibly from others of the same images.
    """

    def __init__(
        self,
        images: UInt8[Tensor, "n c h w"],
        represent: Callable[[Representation, "SeenImages"], Float[Tensor, "n d"]],
    ):
        super().__init__()
        self.images, self._represent = images, represent

    def __missing__(self, kind: Representation) -> Float[Tensor, "n d"]:
        self[kind] = found = self._represent(kind, self)
        return found
