r"""What COSFIRE filters are built on: maps of how strongly a simple feature is present at each pixel."""

from abc import ABC, abstractmethod
from typing import Any

from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.cosfire.tolerance import Move


class Bank(nn.Module, ABC):
    """A family of non-negative response maps, each named by a row of P numbers: its *channel*.

    Attributes:
        learnable: whether maps are differentiable in the numbers of a channel.
    """

    learnable: bool = False

    @abstractmethod
    def grid(self) -> Float[Tensor, "k p"]:
        """The channels that :meth:`describe` returns."""

    @abstractmethod
    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """One non-negative map for each channel of the grid, from which filters are configured.

        Raises:
            UserError: the bank cannot take such images.
        """

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """The largest response of any channel of the grid in each image; thresholds are shares of it."""
        return self.describe(images).amax((1, 2, 3))

    def strength(self, maps: Float[Tensor, "b k y x"]) -> Float[Tensor, "b #k y x"]:
        """The strength that ``t1`` applies to when filters are configured: the responses themselves."""
        return maps

    @abstractmethod
    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u p"]) -> Float[Tensor, "b u y x"]:
        """One non-negative map for each of ``channels``."""

    def options(self) -> dict[str, Any]:
        """Arguments that rebuild the bank, as plain values; empty if it holds a network."""
        return {}


class SteerableBank(Bank):
    """A bank for which the channels of a moved image follow from those of the original.

    With other banks a filter learns the moved forms of its prototype from moved prototypes.
    """

    @abstractmethod
    def moved(self, channels: Float[Tensor, "n p"], move: Move) -> Float[Tensor, "n p"]:
        """The channels that respond to a moved image as ``channels`` do to the original."""


def check_grey(images: Tensor, name: str) -> None:
    """Raise a ``UserError`` unless the images have one channel."""
    if images.shape[1] != 1:
        raise UserError(
            f"{name} takes grey images (b, 1, h, w), got {images.shape[1]} channels",
            "Average them: images.mean(1, keepdim=True).",
        )
