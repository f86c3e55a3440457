r"""Folding for export: inhibition as constant convolutions, rectifiers and a difference.

With constant α ≥ 0 the strength moves into the pull kernel, :math:`\alpha\,\Theta(z) = \Theta(\alpha z)`, and the pull
kernel is stretched (2020) or inverted (2024) once and for all:

.. math:: P = \Theta(W * I + b) - \Theta\bigl((-\alpha\,U(W)) * I - \alpha b\bigr)
"""

import copy

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sextant.layers.conv_geometry import ConvGeometry
from sextant.layers.push_pull import PushPullConv2d
from sextant.layers.push_pull_avg import PushPullAvgConv2d, contrast_offset
from sextant.layers.strength import pull_kernel_size, upsample_kernel


class FoldedPushPull(nn.Module):
    """Push and pull as two plain convolutions, followed by averaging and a bias only where the layer has them."""

    def __init__(self, push: nn.Conv2d, pull: nn.Conv2d, average: int = 1, bias: Tensor | None = None) -> None:
        super().__init__()
        self.push, self.pull = push, pull
        self.bias: Tensor | None
        smooth = nn.AvgPool2d(average, 1, average // 2, count_include_pad=False) if average > 1 else nn.Identity()
        self.smooth = smooth
        self.register_buffer("bias", None if bias is None else bias.view(-1, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        """Push minus pull."""
        response = F.relu(self.push(x)) - F.relu(self.smooth(self.pull(x)))
        return response if self.bias is None else response + self.bias.to(response.dtype)


def fold(network: nn.Module) -> nn.Module:
    """Return a copy of ``network`` with constant inhibition, in evaluation mode and without gradients.

    A push-pull layer (2020) becomes two Conv, two ReLU and one Sub; one of 2024 also gets an average pool and the
    addition of the bias; a layer with h = 1 and α = 1 becomes the plain convolution. Outputs are those of
    ``network.eval()`` up to rounding. The copy cannot be trained further: its pull kernels no longer follow the push
    kernels.

    >>> network = nn.Sequential(PushPullConv2d(1, 4, 3), nn.ReLU())
    >>> any(isinstance(layer, PushPullConv2d) for layer in fold(network).modules())
    False
    """
    folded = copy.deepcopy(network).eval().requires_grad_(False)
    if isinstance(folded, PushPullConv2d | PushPullAvgConv2d):
        return _folded_layer(folded)
    plain: dict[nn.Module, nn.Module] = {}  # a layer used twice stays one layer
    for path, module in list(folded.named_modules(remove_duplicate=False)):
        if isinstance(module, PushPullConv2d | PushPullAvgConv2d):
            if module not in plain:
                plain[module] = _folded_layer(module)
            folded.set_submodule(path, plain[module])
    return folded


@torch.no_grad()
def _folded_layer(layer: PushPullConv2d | PushPullAvgConv2d) -> nn.Module:
    strength = torch.as_tensor(layer.strengths(), dtype=layer.weight.dtype, device=layer.weight.device)
    strength = strength.expand(layer.out_channels)
    kernel = (layer.kernel_size[0], layer.kernel_size[1])
    geometry = ConvGeometry.of_layer(layer)
    if isinstance(layer, PushPullAvgConv2d):
        inverted = contrast_offset(layer.weight).view(-1, 1, 1, 1) - layer.weight
        pull = _plain(strength.view(-1, 1, 1, 1) * inverted, None, geometry)
        return FoldedPushPull(_plain(layer.weight, None, geometry), pull, layer.average, layer.bias)
    push = _plain(layer.weight, layer.bias, geometry)
    wide = (pull_kernel_size(kernel[0], layer.scale), pull_kernel_size(kernel[1], layer.scale))
    if wide == kernel and bool((strength == 1).all()):
        return push
    bias = None if layer.bias is None else -strength * layer.bias
    weight = -strength.view(-1, 1, 1, 1) * upsample_kernel(layer.weight, layer.scale)
    return FoldedPushPull(push, _plain(weight, bias, geometry.grown(kernel, wide)))


def _plain(weight: Tensor, bias: Tensor | None, geometry: ConvGeometry) -> nn.Conv2d:
    """A ``torch.nn.Conv2d`` with this kernel; borders that differ between the sides can only come from "same"."""
    out_channels, in_channels, *kernel = weight.shape
    conv = nn.Conv2d(
        in_channels * geometry.groups,
        out_channels,
        (kernel[0], kernel[1]),
        geometry.stride,
        geometry.before if geometry.before == geometry.after else "same",
        geometry.dilation,
        geometry.groups,
        bias is not None,
        geometry.padding_mode,
        device="meta",
    )
    conv.weight = nn.Parameter(weight.clone(), requires_grad=False)
    conv.bias = None if bias is None else nn.Parameter(bias.clone(), requires_grad=False)
    return conv.eval()
