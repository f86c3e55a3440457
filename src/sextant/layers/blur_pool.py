r"""Anti-aliased downsampling: a binomial low-pass filter before every second pixel is dropped.

The filter of n taps is :math:`b_i = \binom{n-1}{i} / 2^{n-1}`, applied to each channel along both axes. It is
(1, 2, 1)/4 for n = 3; for even n the output is shifted by half a pixel, as for any even kernel.

Source: R. Zhang, "Making convolutional networks shift-invariant again", ICML 2019, section 3.2.
"""

import math
from dataclasses import dataclass
from functools import partial

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.layers.conv_geometry import PaddingMode, pair
from sextant.layers.floating import require_floating
from sextant.layers.surgery import Conversion, Rule, convert
from sextant.ranges import Count, checked


def binomial_taps(taps: int, *, dtype: torch.dtype | None = None) -> Tensor:
    """The binomial filter, which sums to one exactly."""
    return torch.tensor([math.comb(taps - 1, i) / 2 ** (taps - 1) for i in range(taps)], dtype=dtype)


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
        padding_mode: how the border is filled; ``zeros`` darkens the edges, others leave a constant image unchanged.
            ``reflect`` repeats the edge pixels of images that are too small to be mirrored.

    Raises:
        ArgumentError: ``taps`` or ``stride`` is below 1, or the images are not floating-point.
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
            channels = int(channels)  # the older ONNX exporter needs a constant to infer the kernel's shape
        padded = _bordered(x, self.border, self.border_mode)
        kernel = self.kernel.to(x).expand(channels, 1, self.taps, self.taps)
        return F.conv2d(padded, kernel, None, self.stride, groups=channels)

    def extra_repr(self) -> str:
        """The layer's settings."""
        return f"taps={self.taps}, stride={self.stride}, padding_mode={self.padding_mode}"


def _bordered(x: Tensor, border: list[int], mode: str) -> Tensor:
    require_floating(x)
    if mode == "reflect" and int(min(x.size(-2), x.size(-1))) <= max(border):
        mode = "replicate"
    return F.pad(x, border, mode=mode)


torch.fx.wrap("_bordered")  # a symbolic trace cannot compare sizes or types


@checked
@dataclass(frozen=True)
class AntiAliasing:
    """Blurs before every subsampling of a network: an alternative to inhibition that also stabilises predictions.

    Source: R. Zhang, "Making convolutional networks shift-invariant again", ICML 2019, section 3.2.

    >>> AntiAliasing(taps=5)(nn.Sequential(nn.Conv2d(1, 4, 3), nn.MaxPool2d(2)))[1][1]
    BlurPool2d(taps=5, stride=(2, 2), padding_mode=reflect)

    Args:
        taps: length of the binomial filter.
    """

    taps: Count = 3

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it; errors are those of :func:`anti_alias`."""
        anti_alias(network, self.taps)
        return network


def anti_alias(network: nn.Module, taps: int = 3, where: str = "*") -> Conversion:
    """Blur before subsampling in the max-pools and strided convolutions of ``network``, in place.

    >>> network = nn.Sequential(nn.Conv2d(3, 8, 3, stride=2, padding=1), nn.ReLU())
    >>> conversion = anti_alias(network)
    >>> network[0]
    Sequential(
      (0): Conv2d(3, 8, kernel_size=(3, 3), stride=(1, 1), padding=(1, 1))
      (1): BlurPool2d(taps=3, stride=(2, 2), padding_mode=reflect)
    )

    Args:
        taps: length of the binomial filter.
        where: pattern of module paths, as in :class:`sextant.layers.Rule`.

    Raises:
        UserError: no module that subsamples matches ``where``.
    """
    pools = Rule(where, partial(anti_aliased_pool, taps=taps), nn.MaxPool2d, _pool_objection)
    convs = Rule(where, partial(anti_aliased_conv, taps=taps), nn.Conv2d, _conv_objection)
    there = [(path, module) for path, module in network.named_modules() if path]
    useful = [
        rule for rule in (pools, convs) if any(rule.matches(m, [p]) and rule.objection(m) is None for p, m in there)
    ]
    return convert(network, useful or [convs])


def anti_aliased_pool(pool: nn.MaxPool2d, taps: int = 3) -> nn.Sequential:
    """Return ``pool`` with stride 1, then a blur with the original stride; the output size stays the same.

    >>> anti_aliased_pool(nn.MaxPool2d(2))[0]
    MaxPool2d(kernel_size=2, stride=1, padding=0, dilation=1, ceil_mode=False)

    Raises:
        ValueError: the pool rounds sizes up or returns indices.
    """
    if pool.ceil_mode or pool.return_indices:
        raise ValueError("a max-pool with ceil_mode or return_indices has no anti-aliased form of the same output")
    dense = nn.MaxPool2d(pool.kernel_size, 1, pool.padding, pool.dilation)
    return nn.Sequential(dense, BlurPool2d(taps, _two(pool.stride)))


def anti_aliased_conv(conv: nn.Conv2d, taps: int = 3) -> nn.Sequential:
    """Return ``conv`` with its stride set to 1, in place, then a blur with that stride; the output size stays the same.

    A plain 1x1 convolution commutes with the blur, which then comes first and saves most of the multiplications.

    >>> anti_aliased_conv(nn.Conv2d(3, 8, 3, stride=2))[0].stride
    (1, 1)
    """
    blur = BlurPool2d(taps, _two(conv.stride))
    conv.stride = (1, 1)
    if type(conv) is nn.Conv2d and conv.kernel_size == (1, 1) and conv.padding in ("valid", (0, 0)):
        return nn.Sequential(blur, conv)
    return nn.Sequential(conv, blur)


def _pool_objection(module: nn.Module) -> str | None:
    assert isinstance(module, nn.MaxPool2d)
    if _two(module.stride) == (1, 1):
        return "it does not subsample"
    return "ceil_mode or return_indices" if module.ceil_mode or module.return_indices else None


def _conv_objection(module: nn.Module) -> str | None:
    assert isinstance(module, nn.Conv2d)
    return "it does not subsample" if module.stride == (1, 1) else None


def _two(value: int | tuple[int, ...]) -> tuple[int, int]:
    return (value, value) if isinstance(value, int) else (value[0], value[1])
