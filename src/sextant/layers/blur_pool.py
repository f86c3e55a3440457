r"""Anti-aliased downsampling: a binomial low-pass filter before every second pixel is dropped.

The filter of n taps is :math:`b_i = \binom{n-1}{i} / 2^{n-1}`, applied to each channel along both axes. It is
(1, 2, 1)/4 for n = 3; for even n the output is shifted by half a pixel, as for any even kernel.

Source: R. Zhang, "Making convolutional networks shift-invariant again", ICML 2019, section 3.2.
"""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
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

    >>> blur_pool(torch.ones(1, 8, 31, 32)).shape
    torch.Size([1, 8, 16, 16])

    Args:
        taps: n, the length of the filter; 1 only subsamples.
        stride: pixels between samples, for height and width.
        padding_mode: how the border is filled; ``zeros`` darkens the edges, the others leave a constant image as it is.

    Raises:
        ArgumentError: ``taps`` or ``stride`` is below 1.
    """
    return BlurPool2d(taps, stride, padding_mode)(x)  # type: ignore[no-any-return]


class BlurPool2d(nn.Module):
    """:func:`blur_pool` as a layer, for any number of channels; it has no parameters.

    It can be scripted, traced and exported.

    >>> BlurPool2d()(torch.ones(1, 8, 32, 32)).shape
    torch.Size([1, 8, 16, 16])

    Args:
        taps, stride, padding_mode: as for :func:`blur_pool`.
    """

    kernel: Tensor

    def __init__(self, taps: int = 3, stride: int | tuple[int, int] = 2, padding_mode: PaddingMode = "reflect") -> None:
        super().__init__()
        rows, columns = pair(stride)
        if taps < 1 or min(rows, columns) < 1:
            raise ArgumentError(f"taps={taps} and stride={stride} must be at least 1")
        self.taps, self.stride, self.padding_mode = taps, (rows, columns), padding_mode
        self.border = [(taps - 1) // 2, taps // 2] * 2
        self.border_mode = "constant" if padding_mode == "zeros" else str(padding_mode)
        profile = binomial_taps(taps, dtype=torch.float64)
        self.register_buffer("kernel", (profile[:, None] * profile)[None, None], persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """Filter and subsample images of shape (*b, c, h, w)."""
        channels = x.size(-3)
        if torch.jit.is_tracing():  # type: ignore[attr-defined]
            channels = int(channels)  # the older ONNX exporter needs a constant to know the kernel's shape
        padded = F.pad(x, self.border, mode=self.border_mode)
        kernel = self.kernel.to(x).expand(channels, 1, self.taps, self.taps)
        return F.conv2d(padded, kernel, None, self.stride, groups=channels)

    def extra_repr(self) -> str:
        """The layer's settings."""
        return f"taps={self.taps}, stride={self.stride}, padding_mode={self.padding_mode}"
