"""How images and maps go on beyond their border."""

from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

#: black; the border's value; mirrored without repeating the border's pixel; the opposite side
Border = Literal["zeros", "replicate", "reflect", "circular"]


def padded(maps: Float[Tensor, "*b h w"], margin: int, border: Border, fill: float = 0.0) -> Float[Tensor, "*b H W"]:
    """Maps with ``margin`` added on every side, of any size: mirrors and circles go on as often as needed.

    Args:
        fill: what stands beyond the border of ``zeros``.
    """
    if border == "zeros":
        return F.pad(maps, (margin,) * 4, value=fill)
    wide = maps.reshape(-1, 1, *maps.shape[-2:])
    x, y = margin, margin
    while x or y:
        # what the maps can give at a time; of a single line a mirror can only repeat that line
        height, width = (size - (border == "reflect") for size in wide.shape[-2:])
        mode, dx, dy = border, min(x, width), min(y, height)
        if border == "replicate" or not (dx or dy):
            mode, dx, dy = "replicate", x, y
        wide = F.pad(wide, (dx, dx, dy, dy), mode=mode)
        x, y = x - dx, y - dy
    return wide.reshape(*maps.shape[:-2], *wide.shape[-2:])
