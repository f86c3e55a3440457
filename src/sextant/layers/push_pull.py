"""Push-pull inhibition: a convolution whose response is suppressed by a wider, negated copy of its own kernel.

Source: N. Strisciuglio, M. Lopez-Antequera, N. Petkov, "Enhanced robustness of convolutional networks with a push-pull
inhibition layer", Neural Computing and Applications 32, 2020, section 3.1.
"""

import math
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

PaddingMode = Literal["zeros", "reflect", "replicate", "circular"]


def pull_kernel_size(size: int, scale: float) -> int:
    """Side of the pull kernel: the largest odd integer not above ``size * scale``, plus two if that was even.

    ``K = floor(s h) + 1 - (floor(s h) mod 2)``; for ``h = 2`` sizes 3, 5, 7 give 7, 11, 15. ``h = 1`` keeps the size.
    """
    if scale == 1:
        return size
    stretched = math.floor(size * scale)
    return stretched + 1 - stretched % 2


def upsample_kernel(weight: Float[Tensor, "o c kh kw"], scale: float) -> Float[Tensor, "o c KH KW"]:
    """The pull kernel ``k ↑ h`` before its sign is turned: ``weight`` stretched bilinearly with its corners aligned.

    There is no renormalisation, as in the paper's code: the L1 norm grows about 3.9 times for size 3 and ``h = 2``.
    """
    size = (pull_kernel_size(weight.shape[2], scale), pull_kernel_size(weight.shape[3], scale))
    if size == weight.shape[2:]:
        return weight
    return F.interpolate(weight, size=size, mode="bilinear", align_corners=True)


def push_pull(
    x: Float[Tensor, "b ci h w"],
    weight: Float[Tensor, "co cg kh kw"],
    bias: Float[Tensor, "co"] | None = None,
    *,
    scale: float = 2.0,
    alpha: float | Float[Tensor, "co"] = 1.0,
    stride: tuple[int, int] = (1, 1),
    padding: tuple[int, int] = (0, 0),
    dilation: tuple[int, int] = (1, 1),
    groups: int = 1,
    padding_mode: PaddingMode = "zeros",
) -> Float[Tensor, "b co H W"]:
    r"""Push-pull response :math:`P = \Theta(k * I + b) - \alpha\,\Theta(-(k\uparrow h) * I - b)`, with Θ the ReLU.

    The output has the size that the plain convolution would have, and may be negative.
    With ``scale=1`` both kernels coincide and the response is exactly ``leaky_relu(conv(x), alpha)``; with ``alpha=1``
    besides, it is the plain convolution, bit for bit, and so are its gradients.

    Args:
        weight: push kernels; kernel sides must be odd when ``scale > 1``, so that push and pull share a centre.
        bias: added inside the push's ReLU and subtracted inside the pull's.
        scale: the upsampling factor h of the pull kernel, at least 1.
        alpha: strength of the inhibition, one number or one a channel, at least 0.
        padding_mode: how the border is filled, as in ``torch.nn.Conv2d``.

    Raises:
        ValueError: ``scale`` is below 1, or it is above 1 and a kernel side is even.
    """
    kernel = (weight.shape[2], weight.shape[3])
    if scale < 1 or (scale > 1 and (kernel[0] % 2 == 0 or kernel[1] % 2 == 0)):
        raise ValueError(
            f"push-pull needs scale >= 1 and, above 1, odd kernel sides; got scale={scale}, kernel={kernel}"
        )

    def convolve(kernels: Tensor, offset: Tensor | None, pad: tuple[int, int]) -> Tensor:
        if padding_mode == "zeros":
            return F.conv2d(x, kernels, offset, stride, pad, dilation, groups)
        padded = F.pad(x, (pad[1], pad[1], pad[0], pad[0]), mode=padding_mode)
        return F.conv2d(padded, kernels, offset, stride, 0, dilation, groups)

    response = convolve(weight, bias, padding)
    pull_weight = upsample_kernel(weight, scale)
    if pull_weight is weight:  # h = 1: pull = -push, so one convolution serves both
        if not isinstance(alpha, Tensor):
            return F.leaky_relu(response, alpha)
        return torch.where(response > 0, response, alpha.view(-1, 1, 1) * response)

    growth = [dilation[i] * (pull_weight.shape[2 + i] - kernel[i]) // 2 for i in (0, 1)]
    wider = (padding[0] + growth[0], padding[1] + growth[1])
    pull = F.relu(convolve(-pull_weight, None if bias is None else -bias, wider))
    strength = alpha.view(-1, 1, 1) if isinstance(alpha, Tensor) else alpha
    return F.relu(response) - strength * pull


class PushPullConv2d(nn.Conv2d):
    """A drop-in for ``torch.nn.Conv2d`` with push-pull inhibition; see :func:`push_pull` for the equation.

    It has the parameters of the convolution it replaces, and one more a channel only if ``train_alpha``: then the
    strengths start uniform in ``[0.5 - r, 0.5 + r]``, ``r = 1 / sqrt(in_channels * out_channels)``, and act as ReLU(α).

    Args:
        scale: upsampling factor h of the pull kernel, at least 1.
        alpha: inhibition strength, at least 0; ignored if ``train_alpha``.
        train_alpha: learn one strength a channel.
        other arguments: as in ``torch.nn.Conv2d``.

    Raises:
        ValueError: ``scale < 1``, ``alpha < 0``, or an even kernel side with ``scale > 1``.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel_size: int | tuple[int, int],
        stride: int | tuple[int, int] = 1,
        padding: int | tuple[int, int] | Literal["same", "valid"] = 0,
        dilation: int | tuple[int, int] = 1,
        groups: int = 1,
        bias: bool = True,
        padding_mode: PaddingMode = "zeros",
        *,
        scale: float = 2.0,
        alpha: float = 1.0,
        train_alpha: bool = False,
        device: torch.device | str | None = None,
        dtype: torch.dtype | None = None,
    ):
        super().__init__(
            in_channels, out_channels, kernel_size, stride, padding, dilation, groups, bias, padding_mode, device, dtype
        )
        if scale < 1 or (scale > 1 and any(side % 2 == 0 for side in self.kernel_size)):
            raise ValueError(f"scale must be >= 1, with odd kernel sides above 1; got {scale} and {self.kernel_size}")
        if alpha < 0:
            raise ValueError(f"alpha must be >= 0, got {alpha}")
        if padding == "same" and any(d * (k - 1) % 2 for d, k in zip(self.dilation, self.kernel_size, strict=True)):
            raise ValueError(f"padding='same' needs odd kernel sides or even dilations, got {self.kernel_size}")
        self.scale = scale
        self.alpha: float | nn.Parameter = alpha
        if train_alpha:
            spread = 1 / math.sqrt(in_channels * out_channels)
            start = torch.empty(out_channels, device=device, dtype=dtype).uniform_(0.5 - spread, 0.5 + spread)
            self.alpha = nn.Parameter(start)

    @classmethod
    def from_conv(
        cls, conv: nn.Conv2d, *, scale: float = 2.0, alpha: float = 1.0, train_alpha: bool = False
    ) -> "PushPullConv2d":
        """The push-pull layer with the geometry of ``conv``, sharing its weight and bias parameters."""
        layer = cls(
            conv.in_channels,
            conv.out_channels,
            conv.kernel_size,  # type: ignore[arg-type]
            conv.stride,  # type: ignore[arg-type]
            conv.padding,  # type: ignore[arg-type]
            conv.dilation,  # type: ignore[arg-type]
            conv.groups,
            conv.bias is not None,
            conv.padding_mode,
            scale=scale,
            alpha=alpha,
            train_alpha=train_alpha,
            device="meta" if not train_alpha else conv.weight.device,
            dtype=conv.weight.dtype,
        )
        layer.weight, layer.bias = conv.weight, conv.bias
        return layer.train(conv.training)

    def forward(self, x: Tensor) -> Tensor:
        """Apply :func:`push_pull` with this layer's parameters; shapes as in ``torch.nn.Conv2d``."""
        return push_pull(
            x,
            self.weight,
            self.bias,
            scale=self.scale,
            alpha=F.relu(self.alpha) if isinstance(self.alpha, Tensor) else self.alpha,
            stride=self.stride,  # type: ignore[arg-type]
            padding=self._padding_each_side(),
            dilation=self.dilation,  # type: ignore[arg-type]
            groups=self.groups,
            padding_mode=self.padding_mode,
        )

    def _padding_each_side(self) -> tuple[int, int]:
        if self.padding == "valid":
            return (0, 0)
        if self.padding == "same":
            height, width = (d * (k - 1) // 2 for d, k in zip(self.dilation, self.kernel_size, strict=True))
            return (height, width)
        return self.padding  # type: ignore[return-value]

    def extra_repr(self) -> str:
        """The convolution's description, with h and α."""
        alpha = "trained" if isinstance(self.alpha, Tensor) else self.alpha
        return f"{super().extra_repr()}, scale={self.scale}, alpha={alpha}"
