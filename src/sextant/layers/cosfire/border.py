"""How images and maps go on beyond their border."""

from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

#: black; the border's value; mirrored without repeating the border's pixel; the opposite side
Border = Literal["zeros", "replicate", "reflect", "circular"]


def padded(
    maps: Float[Tensor, "*b h w"], margins: tuple[int, int, int, int], border: Border, fill: float = 0.0
) -> Float[Tensor, "*b H W"]:
    """Maps with ``margins`` (left, right, top, bottom) of any size added: mirrors and circles go on as often as needed.

    Args:
        fill: what stands beyond the border of ``zeros``.
    """
    if border == "zeros":
        return F.pad(maps, margins, value=fill)
    left, right, top, bottom = margins
    flat = maps.reshape(-1, 1, *maps.shape[-2:])
    mode = border
    while left or right or top or bottom:
        height, width = flat.shape[-2:]
        most = (height - 1, width - 1) if border == "reflect" else (height, width)
        if border == "reflect" and min(height, width) < 2:
            mode = "replicate"  # nothing to mirror
        if mode == "replicate":
            most = (max(top, bottom), max(left, right))
        now = (min(left, most[1]), min(right, most[1]), min(top, most[0]), min(bottom, most[0]))
        flat = F.pad(flat, now, mode=mode)
        left, right, top, bottom = left - now[0], right - now[1], top - now[2], bottom - now[3]
    return flat.reshape(*maps.shape[:-2], *flat.shape[-2:])
