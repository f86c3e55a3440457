"""Linear maps about the centre of images, with black outside."""

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.corruptions.filtering.bilinear import bilinear


def affine_warp(
    images: Float[Tensor, "b c h w"], matrices: Float[Tensor, "b 2 2"], shifts: Float[Tensor, "b 2"] | None = None
) -> Float[Tensor, "b c h w"]:
    """``y(p) = x(A (p - o) + o + t)`` with p = (column, row) in pixels and o the image's centre, bilinear.

    The matrix maps the result into the image, as an inverse map does. What lies outside the image is 0, except within
    one pixel of its border, where it fades.

    Args:
        images: images to warp.
        matrices: A of each image.
        shifts: t of each image, in pixels to the right and down.

    Example:
        >>> image = torch.tensor([[[[1.0, 2.0, 3.0]]]])
        >>> affine_warp(image, torch.tensor([[[-1.0, 0.0], [0.0, 1.0]]])).flatten()  # columns the other way round
        tensor([3., 2., 1.])
        >>> affine_warp(image, torch.eye(2)[None], torch.tensor([[1.0, 0.0]])).flatten()  # from one pixel to the right
        tensor([2., 3., 0.])
    """
    height, width = images.shape[-2:]
    centre = torch.tensor([(width - 1) / 2, (height - 1) / 2], dtype=torch.float64)
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    points = torch.stack([columns, rows], -1) - centre
    sources = torch.einsum("bij,hwj->bhwi", matrices.double(), points) + centre
    if shifts is not None:
        sources = sources + shifts.double()[:, None, None]
    # computed in double precision on the CPU, so that whole pixels are whole on every device
    sources = sources.to(images)
    return bilinear(images, sources[..., 1], sources[..., 0], "zero")
