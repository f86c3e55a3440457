r"""Push-pull with a contrast-inverted kernel and an averaged pull response: the layer of 2024.

.. math:: P = \Theta(W * I) - \alpha\,\Theta(\mathrm{avg}(W^- * I)) + b, \qquad
          W^-_o = -W_o + c_o, \quad c_o = \max W_o + \min W_o

The maximum and minimum are over the kernel of output channel o, so that its pull kernel has the range of the push
kernel with its contrast inverted. ``avg`` is the mean over a square around each response, of the responses that exist
(none beyond the border). The layer of 2020 stretches the kernel and adds the bias within the rectifiers; this one
smooths the response and adds the bias after them.

Since the pull kernel is the negated push kernel plus a constant, the pull needs no second convolution:

.. math:: W^-_o * I = -\,W_o * I + c_o \, (\mathbb{1} * I),

where :math:`\mathbb{1} * I` sums the image over the kernel's window, once for all output channels of a group. This
holds with zero padding too, as the sum pads its window with the same zeros.

Source: G. S. Bennabhaktula, E. Alegre, N. Strisciuglio, G. Azzopardi, "PushPull-Net: Inhibition-driven ResNet robust to
image corruptions", ICPR 2024, arXiv 2408.04077; the form without a second convolution follows from it. A trained
strength acts here as ReLU(α), as in the layer of 2020; the authors' may become negative.
"""

from typing import Literal, get_args

import torch
import torch.fx
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from sextant.layers.conv_geometry import ConvGeometry, Padding, PaddingMode
from sextant.layers.depth_first import depth_first, overwriting
from sextant.layers.inhibited_conv import InhibitedConv2d
from sextant.layers.strength import Strength, strength_factor

AvgChoice = Literal["box", "direct"]
torch.fx.wrap("push_pull_avg")  # one node of a traced network


def contrast_offset(weight: Float[Tensor, "co cg kh kw"]) -> Float[Tensor, "co"]:
    """:math:`c_o`, the largest plus the smallest weight of each output channel."""
    return weight.amax((1, 2, 3)) + weight.amin((1, 2, 3))


def push_pull_avg(
    x: Float[Tensor, "*b ci h w"],
    weight: Float[Tensor, "co cg kh kw"],
    bias: Float[Tensor, "co"] | None = None,
    *,
    average: int = 3,
    alpha: float | Float[Tensor, "co"] = 1.0,
    stride: int | tuple[int, int] = 1,
    padding: Padding = 0,
    dilation: int | tuple[int, int] = 1,
    groups: int = 1,
    padding_mode: PaddingMode = "zeros",
    impl: AvgChoice = "box",
) -> Float[Tensor, "*b co H W"]:
    r""":math:`\Theta(W * I) - \alpha\,\Theta(\mathrm{avg}(W^- * I)) + b`, see the module's description.

    The output has the size of the plain convolution's. With ``alpha=0`` it is ``relu(conv(x)) + bias``.

    >>> push_pull_avg(torch.rand(2, 3, 32, 32), torch.randn(8, 3, 5, 5), padding=2).shape
    torch.Size([2, 8, 32, 32])

    Args:
        average: side of the square over which the pull is averaged, in responses; odd; 1 leaves it as it is.
        alpha: strength of the inhibition, one number or one per channel, at least 0.
        impl: ``box`` needs no second convolution, ``direct`` does; only rounding and time depend on it.
        other arguments: as in ``torch.nn.functional.conv2d``, with the padding modes of ``torch.nn.Conv2d``.

    Raises:
        ValueError: ``average`` is even or below 1; ``alpha`` is negative, not finite or a tensor of another shape,
            whose values are not checked; ``impl`` is unknown; or as in ``ConvGeometry.of``.
    """
    if average < 1 or average % 2 != 1:
        raise ValueError(f"average must be odd and at least 1, got {average}")
    if impl not in ("box", "direct"):
        raise ValueError(f"impl must be box or direct, got {impl!r}")
    geometry = ConvGeometry.of((weight.shape[2], weight.shape[3]), stride, padding, dilation, groups, padding_mode)
    offset = contrast_offset(weight)
    strength = strength_factor(alpha, weight.shape[0])

    def respond(x: Tensor) -> Tensor:
        push = geometry.convolve(x, weight, None)
        # the negated pull, summed but not yet divided by the number of responses in each mean
        if impl == "direct":
            negated = _sums_nearby(geometry.convolve(x, weight - offset.view(-1, 1, 1, 1), None), average)
        else:
            brightness = _sums_nearby(window_sums(x, (weight.shape[2], weight.shape[3]), geometry), average)
            brightness = brightness.repeat_interleave(weight.shape[0] // groups, dim=-3) if groups > 1 else brightness
            negated = torch.addcmul(_sums_nearby(push, average), offset.view(-1, 1, 1), brightness, value=-1)
        inhibition = negated.clamp_max_(0)
        factor = strength
        if average > 1:
            factor = strength / _sums_nearby(push.new_ones(1, *push.shape[-2:]), average)  # the divisor is positive
        push = push.relu_() if average == 1 or impl == "direct" or overwriting() else F.relu(push)
        if isinstance(factor, Tensor):
            response = (push.addcmul_ if overwriting() else push.addcmul)(factor, inhibition)
        else:
            response = (push.add_ if overwriting() else push.add)(inhibition, alpha=factor)
        response = response.to(push.dtype)
        if bias is None:
            return response
        return (response.add_ if overwriting() else response.add)(bias.view(-1, 1, 1)).to(push.dtype)

    return depth_first(respond, x, weight, geometry.stride)


def window_sums(
    x: Float[Tensor, "*b ci h w"], kernel: tuple[int, int], geometry: ConvGeometry
) -> Float[Tensor, "*b g H W"]:
    """The image summed over the kernel's window and each group's channels: a convolution with ones."""
    sums = x.unflatten(-3, (geometry.groups, -1)).sum(-3)
    bordered, zeros = geometry.with_border(sums)
    planes = bordered.reshape(-1, 1, *bordered.shape[-2:])  # every plane by itself: (b g, 1, h, w)
    planes = F.conv2d(planes, x.new_ones(1, 1, *kernel), None, geometry.stride, zeros, geometry.dilation)
    return planes.view(*sums.shape[:-2], *planes.shape[-2:])


def _sums_nearby(responses: Float[Tensor, "*b c h w"], side: int) -> Float[Tensor, "*b c h w"]:
    """Sums over a square around each response, by a convolution: several times faster here than average pooling."""
    if side == 1:
        return responses
    channels = responses.shape[-3]
    return F.conv2d(responses, responses.new_ones(channels, 1, side, side), padding=side // 2, groups=channels)


class PushPullAvgConv2d(InhibitedConv2d):
    """A drop-in for ``torch.nn.Conv2d``: see :func:`push_pull_avg` for the equation.

    It has the parameters of the convolution it replaces, plus one per channel only if ``train_alpha``: then the
    strengths start uniform in [0, 1] and act as ReLU(α). Unlike push-pull, no setting reduces it to the convolution.

    >>> layer = PushPullAvgConv2d(3, 16, 3, padding=1, average=5, alpha=0.5)
    >>> layer(torch.rand(8, 3, 32, 32)).shape
    torch.Size([8, 16, 32, 32])

    Args:
        average: side of the square over which the pull is averaged; odd; 1 leaves it as it is.
        alpha: inhibition strength, at least 0, one number or one per channel; ignored if ``train_alpha``.
        train_alpha: learn one strength per channel.
        impl: ``box`` or ``direct``, as in :func:`push_pull_avg`.
        other arguments: as in ``torch.nn.Conv2d``; kernels of any size, even sides included.

    Raises:
        ValueError: ``average`` is even or below 1, ``alpha < 0``, or ``impl`` is unknown.
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
        average: int = 3,
        alpha: Strength = 1.0,
        train_alpha: bool = False,
        impl: AvgChoice = "box",
        device: torch.device | str | None = None,
        dtype: torch.dtype | None = None,
    ):
        super().__init__(
            in_channels, out_channels, kernel_size, stride, padding, dilation, groups, bias, padding_mode, device, dtype
        )
        if average < 1 or average % 2 != 1:
            raise ValueError(f"average must be odd and at least 1, got {average}")
        if impl not in get_args(AvgChoice):
            raise ValueError(f"impl must be one of {', '.join(get_args(AvgChoice))}, got {impl!r}")
        self.average = average
        self.impl: AvgChoice = impl
        if train_alpha:
            self._train_alpha(0, 1)
        else:
            self._set_alpha(alpha)

    def set_strength(self, alpha: Strength) -> None:
        """Change the inhibition of a layer in use; trained strengths are overwritten.

        Raises:
            ValueError: as in the constructor.
        """
        self._set_alpha(alpha)

    def implementation(self, height: int, width: int) -> AvgChoice:
        """How the pull is computed for an image of this size, for a run to record."""
        return self.impl

    def forward(self, x: Tensor) -> Tensor:
        """Apply :func:`push_pull_avg` with this layer's parameters; shapes as in ``torch.nn.Conv2d``."""
        return push_pull_avg(
            x,
            self.weight,
            self.bias,
            average=self.average,
            alpha=self.strengths(),
            stride=self.stride,  # type: ignore[arg-type]
            padding=self.padding,  # type: ignore[arg-type]
            dilation=self.dilation,  # type: ignore[arg-type]
            groups=self.groups,
            padding_mode=self.padding_mode,
            impl=self.impl,
        )

    def extra_repr(self) -> str:
        """The convolution's description, with the averaging and α."""
        return f"{super().extra_repr()}, average={self.average}, alpha={self._described_alpha()}"
