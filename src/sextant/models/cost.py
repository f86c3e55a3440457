r"""The cost of a network: its parameters, and the multiply-accumulate operations (MACs) for one image.

Per output pixel, a convolution with C input and O output channels, g groups and an :math:`s \times s` kernel takes
:math:`O C s^2 / g` MACs; a linear layer takes as many as it has weights. For its K x K pull kernel, push-pull adds

.. math:: O C K^2 / g \quad\text{(direct)}, \qquad O C s^2 / g + C (1 + s) a \quad\text{(factorised)},

with a the number of nonzero entries of the s x K interpolation matrix A: as the pull kernel is :math:`A^T W A`, its
response is a sum over :math:`s^2` separable responses of the input. With h = 1, pull and push are one convolution. This
is what the arithmetic needs: an implementation may also multiply by zeros if that is faster, and with a stride the
first of the two separable passes runs over more pixels than the output has. The layer of 2024 adds :math:`O C s^2 / g`
with a second convolution (direct) or :math:`C s^2` for the sum over the window that replaces it (factorised).

Normalisation, activations, pooling and additions are not multiplications of weights and are not counted, as is usual.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor, nn

from sextant.layers import PushPullAvgConv2d, PushPullConv2d, pull_kernel_size
from sextant.layers.network_stages import evaluating

Pull = Literal["direct", "factorised"]
#: modules whose multiplications are not counted
NORMALISATION = (nn.modules.batchnorm._BatchNorm, nn.GroupNorm, nn.LayerNorm, nn.modules.instancenorm._InstanceNorm)


@dataclass(frozen=True)
class LayerCost:
    """One layer: its path, its MACs for an image, and how many of them are the pull's."""

    path: str
    macs: int
    pull_macs: int = 0


@dataclass(frozen=True)
class NetworkCost:
    """Cost of a network for one image.

    Attributes:
        parameters: number of trainable parameters; those that two layers share count once.
        layers: cost of each layer, in the order of the pass; a layer that runs twice counts twice.
        uncounted: paths of modules with parameters for which there is no rule; ``macs`` is too low if there are any.
    """

    parameters: int
    layers: tuple[LayerCost, ...]
    uncounted: tuple[str, ...]

    @property
    def macs(self) -> int:
        """MACs of the whole network."""
        return sum(layer.macs for layer in self.layers)

    @property
    def pull_macs(self) -> int:
        """MACs that inhibition adds to the network."""
        return sum(layer.pull_macs for layer in self.layers)


def network_cost(
    network: nn.Module, image_size: tuple[int, int], in_channels: int, *, pull: Pull = "direct"
) -> NetworkCost:
    """Count parameters and MACs of a network by running it once on a black image.

    Args:
        network: takes images ``(1, in_channels, *image_size)``; it is left unchanged.
        pull: how push-pull layers compute their pull response.

    >>> network = nn.Sequential(nn.Conv2d(3, 8, 3, padding=1), nn.Flatten(), nn.Linear(8 * 16, 10))
    >>> [layer.macs for layer in network_cost(network, (4, 4), 3).layers]  # 16 pixels x 8 x 3 x 3², and 128 x 10
    [3456, 1280]
    """
    layers: list[LayerCost] = []
    uncounted = []
    hooks = []
    for path, module in network.named_modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            hooks.append(module.register_forward_hook(_counter(path, pull, layers)))
        elif not isinstance(module, NORMALISATION) and next(module.parameters(recurse=False), None) is not None:
            uncounted.append(path)
    parameter = next(network.parameters(), torch.empty(0))
    image = torch.zeros(1, in_channels, *image_size, device=parameter.device, dtype=parameter.dtype)
    try:
        with evaluating(network), torch.no_grad():
            network(image)
    finally:
        for hook in hooks:
            hook.remove()
    parameters = sum(p.numel() for p in network.parameters() if p.requires_grad)
    return NetworkCost(parameters, tuple(layers), tuple(uncounted))


def _counter(path: str, pull: Pull, layers: list[LayerCost]) -> Callable[[nn.Module, Any, Tensor], None]:
    def count(layer: nn.Module, inputs: Any, output: Tensor) -> None:
        if isinstance(layer, nn.Linear):  # one output vector for each position before the last dimension
            layers.append(LayerCost(path, output.numel() * layer.in_features))
        elif isinstance(layer, nn.Conv2d):
            pixels = output.shape[-2] * output.shape[-1]
            push = pixels * layer.weight.numel()
            extra = 0
            if isinstance(layer, PushPullConv2d | PushPullAvgConv2d):
                extra = pixels * pull_macs_per_pixel(layer, pull)
            layers.append(LayerCost(path, push + extra, extra))

    return count


def pull_macs_per_pixel(layer: PushPullConv2d | PushPullAvgConv2d, pull: Pull = "direct") -> int:
    """MACs of the pull response for one output pixel, over all output channels; see the module for the equation."""
    height, width = layer.kernel_size
    if isinstance(layer, PushPullAvgConv2d):
        return layer.weight.numel() if pull == "direct" else layer.in_channels * height * width
    tall, wide = (pull_kernel_size(side, layer.scale) for side in (height, width))
    if (tall, wide) == (height, width):
        return 0
    channel_pairs = layer.out_channels * layer.in_channels // layer.groups
    if pull == "direct":
        return channel_pairs * tall * wide
    separable = interpolation_entries(width, wide) + width * interpolation_entries(height, tall)
    return channel_pairs * height * width + layer.in_channels * separable


def interpolation_entries(size: int, stretched: int) -> int:
    """Number of nonzero entries of the matrix that interpolates ``size`` samples to ``stretched``, corners aligned.

    A stretched sample falls onto a sample (one entry) or between two: sizes 3 and 7 give 3 + 5 + 3 = 11.
    """
    if size == 1:
        return stretched
    on_a_sample = math.gcd(size - 1, stretched - 1) + 1
    return 2 * stretched - on_a_sample
