"""The interface of every pooling: from a feature map to one vector."""

from abc import abstractmethod

from jaxtyping import Float
from torch import Tensor, nn


class Pooling(nn.Module):
    """Maps features ``(b, c, h, w)`` to ``(b, features)``.

    Args:
        channels: c.
        size: h and w.
        features: length of the vector.

    Raises:
        ValueError: there are no channels or no cells.
    """

    def __init__(self, channels: int, size: tuple[int, int], features: int):
        super().__init__()
        if channels < 1 or min(size) < 1:
            raise ValueError(f"cannot pool {channels} channels of {size[0]}x{size[1]} cells")
        self.channels, self.size, self.features = channels, (size[0], size[1]), features

    @abstractmethod
    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """One vector per image."""
