"""The geometry of a convolution: stride, borders, dilation and groups, as ``torch.nn.Conv2d`` names them."""

from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

PaddingMode = Literal["zeros", "reflect", "replicate", "circular"]
Padding = int | tuple[int, int] | Literal["same", "valid"]
Number = TypeVar("Number", int, float)


def pair(value: Number | tuple[Number, Number]) -> tuple[Number, Number]:
    """``value`` as a pair, for height and width."""
    return value if isinstance(value, tuple) else (value, value)


@dataclass(frozen=True)
class ConvGeometry:
    """Everything about a convolution but its kernel.

    Args:
        stride: pixels between responses, (vertical, horizontal).
        before: rows above and columns to the left that are added to the image.
        after: rows below and columns to the right; they differ from ``before`` only for ``padding="same"`` with a
            kernel of even extent.
        dilation: pixels between the taps of the kernel.
        groups: number of independent convolutions that the channels are split into.
        padding_mode: what the added pixels hold.
    """

    stride: tuple[int, int] = (1, 1)
    before: tuple[int, int] = (0, 0)
    after: tuple[int, int] = (0, 0)
    dilation: tuple[int, int] = (1, 1)
    groups: int = 1
    padding_mode: PaddingMode = "zeros"

    @classmethod
    def of(
        cls,
        kernel: tuple[int, int],
        stride: int | tuple[int, int] = 1,
        padding: Padding = 0,
        dilation: int | tuple[int, int] = 1,
        groups: int = 1,
        padding_mode: PaddingMode = "zeros",
    ) -> "ConvGeometry":
        """The geometry that ``torch.nn.Conv2d`` has with these arguments and a kernel of that size.

        Raises:
            ValueError: ``padding`` is a word other than "same" and "valid", or "same" with a stride.
        """
        stride, dilation = pair(stride), pair(dilation)
        if padding == "valid":
            before = after = (0, 0)
        elif padding == "same":
            if stride != (1, 1):
                raise ValueError(f"padding='same' needs stride 1, got {stride}")
            total = [d * (k - 1) for d, k in zip(dilation, kernel, strict=True)]
            before = (total[0] // 2, total[1] // 2)
            after = (total[0] - before[0], total[1] - before[1])
        elif isinstance(padding, str):
            raise ValueError(f"padding must be numbers, 'same' or 'valid', got {padding!r}")
        else:
            before = after = pair(padding)
        return cls(stride, before, after, dilation, groups, padding_mode)

    @classmethod
    def of_layer(cls, layer: nn.Conv2d) -> "ConvGeometry":
        """The geometry of a convolution in a network."""
        arguments = (layer.kernel_size, layer.stride, layer.padding, layer.dilation, layer.groups, layer.padding_mode)
        return cls.of(*arguments)  # type: ignore[arg-type]

    def grown(self, kernel: tuple[int, int], wider: tuple[int, int]) -> "ConvGeometry":
        """The geometry that centres kernels of size ``wider`` where this one centres those of size ``kernel``."""
        growth = [d * (w - k) // 2 for d, w, k in zip(self.dilation, wider, kernel, strict=True)]
        before = (self.before[0] + growth[0], self.before[1] + growth[1])
        after = (self.after[0] + growth[0], self.after[1] + growth[1])
        return replace(self, before=before, after=after)

    def with_border(self, x: Float[Tensor, "*b c h w"]) -> tuple[Float[Tensor, "*b c H W"], tuple[int, int]]:
        """Add the border that a convolution cannot add itself; also return the zeros that it still has to add.

        Zeros that are equal on both sides are left to the convolution, as in ``torch.nn.Conv2d``, so that the results
        agree to the last bit.
        """
        (top, left), (bottom, right) = self.before, self.after
        if self.padding_mode != "zeros":
            return F.pad(x, (left, right, top, bottom), mode=self.padding_mode), (0, 0)
        if self.before != self.after:  # "same" puts the extra row below and the extra column to the right
            x = F.pad(x, (0, right - left, 0, bottom - top))
        return x, self.before

    def convolve(
        self, x: Float[Tensor, "*b ci h w"], weight: Float[Tensor, "co cg kh kw"], bias: Float[Tensor, "co"] | None
    ) -> Float[Tensor, "*b co H W"]:
        """Convolve; the result is that of ``torch.nn.Conv2d``, bit for bit."""
        bordered, zeros = self.with_border(x)
        return F.conv2d(bordered, weight, bias, self.stride, zeros, self.dilation, self.groups)
