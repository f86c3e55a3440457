"""How images and maps continue beyond their border."""

from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

#: black; the border's value; mirrored without repeating the border's pixel; the opposite side
Border = Literal["zeros", "replicate", "reflect", "circular"]


def padded(maps: Float[Tensor, "*b h w"], margin: int, border: Border, fill: float = 0.0) -> Float[Tensor, "*b H W"]:
    """Pad maps by ``margin``, of any size, on every side: mirrored and circular borders repeat as often as needed.

    Args:
        fill: value beyond a border of ``zeros``.
    """
    if border == "zeros":
        return F.pad(maps, (margin,) * 4, value=fill)
    wide = maps.reshape(-1, 1, *maps.shape[-2:])
    x, y = margin, margin
    while x or y:
        # as much as the maps can supply at a time; a mirror of a single line can only repeat that line
        height, width = (size - (border == "reflect") for size in wide.shape[-2:])
        mode, dx, dy = border, min(x, width), min(y, height)
        if border == "replicate" or not (dx or dy):
            mode, dx, dy = "replicate", x, y
        wide = F.pad(wide, (dx, dx, dy, dy), mode=mode)
        x, y = x - dx, y - dy
    return wide.reshape(*maps.shape[:-2], *wide.shape[-2:])
