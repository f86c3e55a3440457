"""All features of all cells, one after another: with the linear layer that follows, a fully connected layer.

Every position in the image has its own weights, so that it matters where something is seen: right for a camera that
returns to the same spots, wrong for one that looks from elsewhere. This is the form of Lopez-Antequera et al. 2017.
"""

from jaxtyping import Float
from torch import Tensor

from sextant.layers.cell_means import cell_means
from sextant.models.pooling.pooling import Pooling


class Flatten(Pooling):
    """Concatenates all cells of the map, or its means over a smaller grid.

    Args:
        channels, size: those of the map; other sizes are refused unless there is a grid.
        grid: height and width to average to first, which bounds the weights that follow; None keeps every cell.

    Raises:
        ValueError: the grid is empty or larger than the map.

    Example:
        >>> import torch
        >>> Flatten(channels=1, size=(2, 4), grid=(1, 2))(torch.arange(8.0).reshape(1, 1, 2, 4))  # means of the halves
        tensor([[2.5000, 4.5000]])
    """

    def __init__(self, channels: int, size: tuple[int, int], *, grid: tuple[int, int] | None = None):
        height, width = size if grid is None else grid
        if not (1 <= height <= size[0] and 1 <= width <= size[1]):
            raise ValueError(f"a grid of {height}x{width} does not fit a map of {size[0]}x{size[1]}")
        super().__init__(channels, size, channels * height * width)
        self.grid = None if grid is None else (grid[0], grid[1])

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Channels of the cells, ``k = c h w``."""
        return (x if self.grid is None else cell_means(x, self.grid)).flatten(1)
