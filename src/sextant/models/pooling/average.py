"""The mean of each channel over the map."""

from jaxtyping import Float
from torch import Tensor

from sextant.models.pooling.pooling import Pooling


class Average(Pooling):
    """Global average pooling.

    Args:
        channels, size: those of the map; any size is accepted.

    Example:
        >>> import torch
        >>> Average(channels=1, size=(2, 2))(torch.tensor([[[[0.0, 1.0], [2.0, 3.0]]]]))
        tensor([[1.5000]])
    """

    def __init__(self, channels: int, size: tuple[int, int]):
        super().__init__(channels, size, channels)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c"]:
        """Mean of each channel."""
        return x.mean((2, 3))
