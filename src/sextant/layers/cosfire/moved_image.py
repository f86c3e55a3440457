"""An image mirrored, turned and enlarged about a point."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.cosfire.tolerance import Move


def moved_image(
    image: Float[Tensor, "1 c h w"], point: tuple[float, float], move: Move
) -> tuple[Float[Tensor, "1 c H W"], tuple[float, float]]:
    """The image moved by ``move``, and where the point (x, y) then is.

    Quarter turns and reflections are exact and may swap height and width. All other moves keep the size and the point,
    interpolate bilinearly, and repeat the border.
    """
    x, y = point
    if move.mirrored:
        image, x = image.flip(-1), image.shape[-1] - 1 - x
    quarters = move.rotation_rad / (math.pi / 2)
    if move.scale == 1 and abs(quarters - round(quarters)) < 1e-9:
        for _ in range(round(quarters) % 4):
            x, y = y, image.shape[-1] - 1 - x
            image = torch.rot90(image, 1, (-2, -1))
        return image, (x, y)
    height, width = image.shape[-2:]
    columns = torch.arange(width, dtype=image.dtype, device=image.device) - x
    rows = torch.arange(height, dtype=image.dtype, device=image.device) - y
    cos, sin = math.cos(move.rotation_rad) / move.scale, math.sin(move.rotation_rad) / move.scale
    # where each pixel comes from: turned back, with y downwards
    from_x = x + cos * columns[None, :] - sin * rows[:, None]
    from_y = y + sin * columns[None, :] + cos * rows[:, None]
    grid = torch.stack([(2 * from_x + 1) / width - 1, (2 * from_y + 1) / height - 1], -1)
    return F.grid_sample(image, grid[None], padding_mode="border", align_corners=False), (x, y)
