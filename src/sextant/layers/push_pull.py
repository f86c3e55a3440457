r"""Push-pull inhibition: a convolution whose response is suppressed by a wider, negated copy of its own kernel.

.. math:: P = \Theta(k * I + b) - \alpha\,\Theta(-(k\uparrow h) * I - b), \qquad \Theta = \mathrm{ReLU}

Source: N. Strisciuglio, M. Lopez-Antequera, N. Petkov, "Enhanced robustness of convolutional networks with a push-pull
inhibition layer", Neural Computing and Applications 32, 2020, section 3.1.
"""

import math
from typing import Literal, get_args

import torch
import torch.fx
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.conv_geometry import ConvGeometry, Padding, PaddingMode
from sextant.layers.depth_first import depth_first, overwriting, traced
from sextant.layers.implementation import PullShape, choose_implementation
from sextant.layers.inhibited_conv import InhibitedConv2d
from sextant.layers.pull_response import Implementation, pull_response
from sextant.layers.strength import Strength, pull_kernel_size, strength_factor

Choice = Literal["auto", "direct", "rows", "factorised"]
torch.fx.wrap("push_pull")  # one node of a traced network: what it does depends on shapes


def push_pull(
    x: Float[Tensor, "*b ci h w"],
    weight: Float[Tensor, "co cg kh kw"],
    bias: Float[Tensor, "co"] | None = None,
    *,
    scale: float = 2.0,
    alpha: float | Float[Tensor, "co"] = 1.0,
    stride: int | tuple[int, int] = 1,
    padding: Padding = 0,
    dilation: int | tuple[int, int] = 1,
    groups: int = 1,
    padding_mode: PaddingMode = "zeros",
    impl: Choice = "auto",
) -> Float[Tensor, "*b co H W"]:
    r"""Push-pull response :math:`P = \Theta(k * I + b) - \alpha\,\Theta(-(k\uparrow h) * I - b)`, with Θ the ReLU.

    The output has the size of the plain convolution's and may be negative.
    With ``scale=1`` both kernels coincide and the response is exactly ``leaky_relu(conv(x), alpha)``. With ``alpha=1``
    as well, it is the plain convolution, bit for bit, and so are its gradients.

    >>> x, weight = torch.rand(2, 3, 32, 32), torch.randn(8, 3, 5, 5)
    >>> push_pull(x, weight, padding=2).shape
    torch.Size([2, 8, 32, 32])
    >>> torch.equal(push_pull(x, weight, scale=1.0), F.conv2d(x, weight))  # with h = 1 and α = 1 the convolution itself
    True

    Args:
        weight: push kernels; kernel sides must be odd when ``scale > 1``, so that push and pull share a centre.
        bias: added inside the push's ReLU and subtracted inside the pull's.
        scale: the upsampling factor h of the pull kernel, at least 1.
        alpha: strength of the inhibition, one number or one per channel, at least 0.
        padding_mode: how the border is filled, as in ``torch.nn.Conv2d``.
        impl: how the pull is computed, see :mod:`sextant.layers.pull_response`; ``auto`` is a fixed rule on the shape.
            While a network is traced, compiled or exported it is ``direct``.
        other arguments: as in ``torch.nn.functional.conv2d``.

    Raises:
        ValueError: ``scale`` is below 1 or not finite, or it is above 1 and a kernel side is even; ``alpha`` is
            negative, not finite or a tensor of another shape, whose values are not checked; ``impl`` is unknown; or as
            in ``ConvGeometry.of``.
    """
    kernel = (weight.shape[2], weight.shape[3])
    if not 1 <= scale < math.inf or (scale > 1 and (kernel[0] % 2 == 0 or kernel[1] % 2 == 0)):
        raise ValueError(
            f"push-pull needs scale >= 1 and, above 1, odd kernel sides; got scale={scale}, kernel={kernel}"
        )
    if impl not in get_args(Choice):
        raise ValueError(f"impl must be one of {', '.join(get_args(Choice))}, got {impl!r}")
    geometry = ConvGeometry.of(kernel, stride, padding, dilation, groups, padding_mode)
    strength = strength_factor(alpha, weight.shape[0])
    if kernel == (pull_kernel_size(kernel[0], scale), pull_kernel_size(kernel[1], scale)):
        # the pull is the negated push, so one convolution serves both
        response = geometry.convolve(x, weight, bias)
        if isinstance(strength, Tensor):
            return torch.where(response > 0, response, strength * response).to(response.dtype)
        return F.leaky_relu(response, strength)
    if traced():
        impl = "direct"  # the other forms would write the image's size into the graph
    chosen = pull_implementation(weight, scale, geometry, (x.shape[-2], x.shape[-1])) if impl == "auto" else impl

    def respond(x: Tensor) -> Tensor:
        push = geometry.convolve(x, weight, bias).relu_()  # in place: its gradient does not need the convolution's
        if not isinstance(strength, Tensor) and strength == 0:
            return push
        pull = pull_response(x, -weight, None if bias is None else -bias, scale, geometry, chosen).relu_()
        if isinstance(strength, Tensor):
            return (push.addcmul_ if overwriting() else push.addcmul)(strength, pull, value=-1).to(push.dtype)
        return (push.sub_ if overwriting() else push.sub)(pull, alpha=strength)

    return depth_first(respond, x, weight, geometry.stride)


def pull_implementation(
    weight: Float[Tensor, "co cg kh kw"], scale: float, geometry: ConvGeometry, size: tuple[int, int]
) -> Implementation:
    """The choice of ``impl="auto"`` for images of this height and width: a pure function of the shapes."""
    out_channels, in_channels, *kernel = weight.shape
    shape = PullShape(
        kernel=(kernel[0], kernel[1]),
        pull=(pull_kernel_size(kernel[0], scale), pull_kernel_size(kernel[1], scale)),
        in_channels=in_channels,
        out_channels=out_channels // geometry.groups,
        groups=geometry.groups,
        stride=geometry.stride,
        size=size,
    )
    return choose_implementation(shape)


class PushPullConv2d(InhibitedConv2d):
    """A drop-in for ``torch.nn.Conv2d`` with push-pull inhibition; see :func:`push_pull` for the equation.

    It has the parameters of the convolution it replaces, plus one per channel only if ``train_alpha``: then the
    strengths start uniform in ``[0.5 - r, 0.5 + r]``, ``r = 1 / sqrt(in_channels * out_channels)``, and act as ReLU(α).

    >>> layer = PushPullConv2d(3, 16, 3, padding=1, scale=2.0, alpha=1.0)
    >>> layer(torch.rand(8, 3, 32, 32)).shape
    torch.Size([8, 16, 32, 32])

    Args:
        scale: upsampling factor h of the pull kernel, at least 1. It is not trained: only kernel sizes that are odd
            integers have a centre, so the response is a step function of h.
        alpha: inhibition strength, at least 0, one number or one per channel; ignored if ``train_alpha``.
        train_alpha: learn one strength per channel.
        impl: as in :func:`push_pull`.
        other arguments: as in ``torch.nn.Conv2d``.

    Raises:
        ValueError: ``scale < 1`` or not finite, ``alpha < 0``, an even kernel side with ``scale > 1``, or an unknown
            ``impl``.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel_size: int | tuple[int, int],
        stride: int | tuple[int, int] = 1,
        padding: Padding = 0,
        dilation: int | tuple[int, int] = 1,
        groups: int = 1,
        bias: bool = True,
        padding_mode: PaddingMode = "zeros",
        *,
        scale: float = 2.0,
        alpha: Strength = 1.0,
        train_alpha: bool = False,
        impl: Choice = "auto",
        device: torch.device | str | None = None,
        dtype: torch.dtype | None = None,
    ):
        super().__init__(
            in_channels, out_channels, kernel_size, stride, padding, dilation, groups, bias, padding_mode, device, dtype
        )
        self._check_scale(scale)
        if impl not in get_args(Choice):
            raise ValueError(f"impl must be one of {', '.join(get_args(Choice))}, got {impl!r}")
        self.scale = scale
        self.impl: Choice = impl
        if train_alpha:
            spread = 1 / math.sqrt(in_channels * out_channels)
            self._train_alpha(0.5 - spread, 0.5 + spread)
        else:
            self._set_alpha(alpha)

    def set_strength(self, alpha: Strength | None = None, scale: float | None = None) -> None:
        """Change the inhibition of a layer in use; None keeps a value. Trained strengths are overwritten.

        ``scale`` acts through the kernel's size alone: with side 3 every ``h < 4/3`` acts as 1, and K is 5 up to
        ``h < 2``. :func:`sextant.layers.strength_path` leads from the convolution to inhibition without such a jump.

        Raises:
            ValueError: as in the constructor.
        """
        if scale is not None:
            self._check_scale(scale)
            self.scale = scale
        if alpha is not None:
            self._set_alpha(alpha)

    def implementation(self, height: int, width: int) -> Implementation:
        """How the pull is computed for an image of this size, for a run to record."""
        if self.impl != "auto":
            return self.impl
        return pull_implementation(self.weight, self.scale, ConvGeometry.of_layer(self), (height, width))

    def forward(self, x: Tensor) -> Tensor:
        """Apply :func:`push_pull` with this layer's parameters; shapes as in ``torch.nn.Conv2d``."""
        return push_pull(
            x,
            self.weight,
            self.bias,
            scale=self.scale,
            alpha=self.strengths(),
            stride=self.stride,  # type: ignore[arg-type]
            padding=self.padding,  # type: ignore[arg-type]
            dilation=self.dilation,  # type: ignore[arg-type]
            groups=self.groups,
            padding_mode=self.padding_mode,
            impl=self.impl,
        )

    def extra_repr(self) -> str:
        """The convolution's description, with h and α."""
        return f"{super().extra_repr()}, scale={self.scale}, alpha={self._described_alpha()}"

    def _check_scale(self, scale: float) -> None:
        if not 1 <= scale < math.inf or (scale > 1 and any(side % 2 == 0 for side in self.kernel_size)):
            raise ValueError(f"scale must be >= 1 and finite, above 1 with odd sides; got {scale}, {self.kernel_size}")
