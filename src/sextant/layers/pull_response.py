r"""Three exact ways to convolve with a stretched kernel :math:`U(W) = A_v W A_h^\top`, equal up to rounding.

``direct``
    Stretch the kernel and convolve with its :math:`K \times K` taps: :math:`O C K^2` products per pixel.
``rows``
    Make an image with s rows for each row of the output: the responses to the s columns of :math:`A_v`, which are
    vertical profiles. Then convolve it with the :math:`s \times K` kernels :math:`W A_h^\top` in steps of s rows:
    :math:`O C s K` products per pixel.
``factorised``
    The same in both directions: s rows and s columns for each response, which W itself then convolves in steps of s
    rows and s columns: :math:`O C s^2`.

Profiles are applied as products with a banded matrix, vertical ones for a few rows of the output at a time. This takes
more products than the K taps need, yet is several times faster than convolving each channel by itself, which few
libraries do well.
Which of the three is fastest depends on the shape: see :mod:`sextant.layers.implementation`.
"""

from functools import cache
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.conv_geometry import ConvGeometry
from sextant.layers.strength import hats, interpolation_matrix, pull_kernel_size, upsample_kernel

Implementation = Literal["direct", "rows", "factorised"]
BAND = 8  # output rows per banded product: with fewer, products are small; with more, they are mostly zeros


def pull_response(
    x: Float[Tensor, "*b ci h w"],
    weight: Float[Tensor, "co cg kh kw"],
    bias: Float[Tensor, "co"] | None,
    scale: float,
    geometry: ConvGeometry,
    implementation: Implementation = "direct",
) -> Float[Tensor, "*b co H W"]:
    """Convolve ``x`` with ``weight`` stretched by ``scale``; the output has the size of the unstretched convolution.

    Args:
        weight: the unstretched kernels, with odd sides.
        geometry: that of the unstretched convolution.
        implementation: how it is computed; only rounding and time depend on it.

    Raises:
        ValueError: there is no such implementation.
    """
    kernel = (weight.shape[2], weight.shape[3])
    wide = (pull_kernel_size(kernel[0], scale), pull_kernel_size(kernel[1], scale))
    geometry = geometry.grown(kernel, wide)
    if implementation == "direct":
        return geometry.convolve(x, upsample_kernel(weight, scale), bias)
    if implementation not in ("rows", "factorised"):
        raise ValueError(f"implementation must be direct, rows or factorised, got {implementation!r}")
    (stride_v, stride_h), (dilation_v, dilation_h) = geometry.stride, geometry.dilation
    x, (above, left) = geometry.with_border(x)
    x = _profile_responses(x, (kernel[0], wide[0]), above, stride_v, dilation_v)  # (*b, ci, H s, w)
    if implementation == "rows":
        across = interpolation_matrix(kernel[1], wide[1], dtype=weight.dtype, device=weight.device)
        weight, steps, dilation = torch.matmul(weight, across.T), (kernel[0], stride_h), (1, dilation_h)
        return F.conv2d(x, weight, bias, steps, (0, left), dilation, geometry.groups)
    width = (x.shape[-1] + 2 * left - dilation_h * (wide[1] - 1) - 1) // stride_h + 1
    matrix = torch.as_tensor(_band_matrix(kernel[1], wide[1], width, stride_h, dilation_h)).to(x)
    x = torch.matmul(F.pad(x, (left, left))[..., : matrix.shape[1]], matrix.T)  # (*b, ci, H s, W s)
    return F.conv2d(x, weight, bias, kernel, groups=geometry.groups)


def _profile_responses(
    x: Float[Tensor, "*b h w"], sides: tuple[int, int], zeros: int, stride: int, dilation: int
) -> Float[Tensor, "*b Hs w"]:
    """The responses to the s profiles centred on each position down the image, one below the other."""
    size, pull_size = sides
    reach = dilation * (pull_size - 1) + 1
    height = (x.shape[-2] + 2 * zeros - reach) // stride + 1
    bands = -(-height // BAND)
    places = -(-height // bands)  # output rows in one band
    span, step = (places - 1) * stride + reach, places * stride
    missing = (bands - 1) * step + span - x.shape[-2] - zeros
    windows = F.pad(x, (0, 0, zeros, max(missing, 0))).unfold(-2, span, step)  # (*b, bands, w, span)
    matrix = torch.as_tensor(_band_matrix(size, pull_size, places, stride, dilation)).to(x)
    return torch.matmul(matrix, windows.mT).flatten(-3, -2)[..., : height * size, :]


@cache
def _band_matrix(size: int, pull_size: int, places: int, stride: int, dilation: int) -> Float[np.ndarray, "ps span"]:
    """Weights by which each profile, at each position, sums the rows of one band."""
    matrix = np.zeros((places, size, (places - 1) * stride + dilation * (pull_size - 1) + 1))
    for place in range(places):
        matrix[place, :, place * stride :: dilation][:, :pull_size] = hats(size, pull_size).T
    return matrix.reshape(places * size, -1)
