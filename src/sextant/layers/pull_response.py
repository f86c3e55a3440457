r"""Three exact ways to convolve with a stretched kernel :math:`U(W) = A_v W A_h^\top`, equal up to rounding.

``direct``
    Stretch the kernel, convolve with its :math:`K \times K` taps: :math:`O C K^2` products a pixel.
``rows``
    Take the responses of the image to the s columns of :math:`A_v`, which are vertical profiles, once a channel; then
    convolve them with the :math:`1 \times K` kernels :math:`W A_h^\top`: :math:`C s n + O C s K`.
``factorised``
    Take the responses to both profiles, :math:`s^2` images a channel, and mix them by :math:`W`, which is then a
    1x1 convolution: :math:`C s n + C s^2 n + O C s^2`.

Profiles are applied as products with a banded matrix of the image's n rows (or columns): many more products than the K
taps need, yet several times faster than convolving each channel by itself, which few libraries do well.
Which of the three is fastest depends on the shape: see :mod:`sextant.layers.implementation`.
"""

from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.conv_geometry import ConvGeometry
from sextant.layers.pull_kernel import interpolation_matrix, pull_kernel_size, upsample_kernel

Implementation = Literal["direct", "rows", "factorised"]


def pull_response(
    x: Float[Tensor, "*b ci h w"],
    weight: Float[Tensor, "co cg kh kw"],
    bias: Float[Tensor, "co"] | None,
    scale: float,
    geometry: ConvGeometry,
    implementation: Implementation = "direct",
) -> Float[Tensor, "*b co H W"]:
    """The convolution of ``x`` with ``weight`` stretched by ``scale``, of the size that the unstretched one has.

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
    x, zeros = geometry.with_border(x)
    vertical, horizontal = (
        interpolation_matrix(kernel[i], wide[i], dtype=weight.dtype, device=weight.device) for i in (0, 1)
    )
    (stride_v, stride_h), (dilation_v, dilation_h) = geometry.stride, geometry.dilation
    over_rows = _profile_matrix(vertical, x.shape[-2], stride_v, zeros[0], dilation_v)  # (s, H, h)
    height = over_rows.shape[1]
    responses = torch.matmul(over_rows.flatten(0, 1), x)  # (*b, ci, s H, w)
    responses = responses.unflatten(-2, (kernel[0], height)).flatten(-4, -3)  # (*b, ci s, H, w)
    if implementation == "rows":
        across = torch.matmul(weight, horizontal.T)  # (co, cg, s, K)
        across = across.flatten(1, 2).unsqueeze(2)  # (co, cg s, 1, K)
        return F.conv2d(responses, across, bias, (1, stride_h), (0, zeros[1]), (1, dilation_h), geometry.groups)
    over_columns = _profile_matrix(horizontal, x.shape[-1], stride_h, zeros[1], dilation_h)  # (s, W, w)
    width = over_columns.shape[1]
    responses = torch.matmul(responses, over_columns.flatten(0, 1).T)  # (*b, ci s, H, s W)
    responses = responses.unflatten(-1, (kernel[1], width)).movedim(-2, -3)  # (*b, ci s, s, H, W)
    return F.conv2d(responses.flatten(-4, -3), weight.flatten(1)[:, :, None, None], bias, groups=geometry.groups)


def _profile_matrix(
    profiles: Float[Tensor, "K s"], length: int, stride: int, zeros: int, dilation: int
) -> Float[Tensor, "s out length"]:
    """What each profile answers at each place to a single pixel: row y of profile i holds the profile, centred on y."""
    pixels = torch.eye(length, dtype=profiles.dtype, device=profiles.device).unsqueeze(1)
    answers = F.conv1d(pixels, profiles.T.unsqueeze(1), stride=stride, padding=zeros, dilation=dilation)
    return answers.permute(1, 2, 0)
