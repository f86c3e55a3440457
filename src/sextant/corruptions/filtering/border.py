"""What lies beyond the edge of an image, with scipy.ndimage's names.

``nearest`` repeats the edge pixel; ``reflect`` mirrors at the edge of the edge pixel (b a | a b c), ``mirror`` at its
centre (c b | a b c), which OpenCV calls REFLECT_101; ``zero`` is black.
"""

from typing import Literal

import torch
from jaxtyping import Int64
from torch import Tensor

Border = Literal["nearest", "reflect", "mirror", "zero"]


def inside(index: Int64[Tensor, "*n"], size: int, border: Border) -> Int64[Tensor, "*n"]:
    """The pixel 0 ... size - 1 that stands for the pixel ``index``, which may lie outside.

    ``zero`` gives the nearest pixel, to which the caller has to give weight zero.

    Example:
        >>> index = torch.arange(-2, 6)  # from two pixels before an axis of four to two behind it
        >>> inside(index, 4, "nearest").tolist()
        [0, 0, 0, 1, 2, 3, 3, 3]
        >>> inside(index, 4, "reflect").tolist()
        [1, 0, 0, 1, 2, 3, 3, 2]
        >>> inside(index, 4, "mirror").tolist()
        [2, 1, 0, 1, 2, 3, 2, 1]
    """
    if border == "reflect":
        folded = index % (2 * size)
        return torch.where(folded < size, folded, 2 * size - 1 - folded)
    if border == "mirror" and size > 1:
        folded = index % (2 * size - 2)
        return torch.where(folded < size, folded, 2 * size - 2 - folded)
    return index.clamp(0, size - 1)
