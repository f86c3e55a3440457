r"""Anti-aliased downsampling: a binomial low-pass filter before every second pixel is dropped.

The filter of n taps is :math:`b_i = \binom{n-1}{i} / 2^{n-1}`, applied along both axes, each channel by itself. It is
(1, 2, 1)/4 for n = 3; for even n the output lies half a pixel off, as for any even kernel.

Source: R. Zhang, "Making convolutional networks shift-invariant again", ICML 2019, section 3.2.
"""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.layers.conv_geometry import PaddingMode, pair


def binomial_taps(taps: int, *, dtype: torch.dtype | None = None, device: torch.device | str | None = None) -> Tensor:
    """The binomial filter, which sums to one exactly."""
    return torch.tensor([math.comb(taps - 1, i) / 2 ** (taps - 1) for i in range(taps)], dtype=dtype, device=device)


def blur_pool(
    x: Float[Tensor, "*b c h w"],
    taps: int = 3,
    stride: int | tuple[int, int] = 2,
    padding_mode: PaddingMode = "reflect",
) -> Float[Tensor, "*b c H W"]:
    """Low-pass filter and subsample; the output is ``ceil(h / stride)`` by ``ceil(w / stride)``.

    Args:
        taps: n, the length of the filter; 1 only subsamples.
        stride: pixels between samples, for height and width.
        padding_mode: how the border is filled; with ``zeros`` the edges darken, with the others a constant image stays.

    Raises:
        ValueError: ``taps`` or ``stride`` is below 1.
    """
    steps = pair(stride)
    if taps < 1 or min(steps) < 1:
        raise ValueError(f"blur_pool needs taps >= 1 and stride >= 1, got taps={taps}, stride={stride}")
    before, after = (taps - 1) // 2, taps // 2
    mode = "constant" if padding_mode == "zeros" else padding_mode
    x = F.pad(x, (before, after, before, after), mode=mode)
    channels = x.shape[-3]
    profile = binomial_taps(taps, dtype=x.dtype, device=x.device)
    kernel = (profile[:, None] * profile).expand(channels, 1, taps, taps)
    return F.conv2d(x, kernel, None, steps, groups=channels)


class BlurPool2d(nn.Module):
    """:func:`blur_pool` as a layer, for any number of channels. It has no parameters."""

    def __init__(self, taps: int = 3, stride: int | tuple[int, int] = 2, padding_mode: PaddingMode = "reflect") -> None:
        super().__init__()
        if taps < 1 or min(pair(stride)) < 1:
            raise ValueError(f"BlurPool2d needs taps >= 1 and stride >= 1, got taps={taps}, stride={stride}")
        self.taps, self.stride, self.padding_mode = taps, stride, padding_mode

    def forward(self, x: Tensor) -> Tensor:
        """Filter and subsample images of shape (*b, c, h, w)."""
        return blur_pool(x, self.taps, self.stride, self.padding_mode)

    def extra_repr(self) -> str:
        """Its settings."""
        return f"taps={self.taps}, stride={self.stride}, padding_mode={self.padding_mode}"
