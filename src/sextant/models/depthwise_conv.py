"""A depthwise convolution that trains quickly under bfloat16 on a CPU."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class DepthwiseConv2d(nn.Conv2d):
    """``torch.nn.Conv2d`` with one filter per channel, whose gradients are computed in float32 on a CPU.

    oneDNN's gradient of such filters is slow in bfloat16: a training step of EfficientNet-Lite0 took longer with it
    than in float32 (``python -m benchmarks precisions`` times the network as it is). Without gradients, on a GPU and in
    float32 it does not differ from its parent.

    Args:
        channels: channels of the input and of the output.
        kernel_size, stride, padding: as in ``torch.nn.Conv2d``.

    Example:
        >>> DepthwiseConv2d(8, 3, padding=1)(torch.rand(2, 8, 6, 5)).shape
        torch.Size([2, 8, 6, 5])
    """

    def __init__(self, channels: int, kernel_size: int, stride: int = 1, padding: int = 0):
        super().__init__(channels, channels, kernel_size, stride, padding, groups=channels, bias=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h2 w2"]:
        """The filtered map, in float32 where gradients are kept under autocast on a CPU."""
        if not (x.device.type == "cpu" and torch.is_autocast_enabled("cpu") and torch.is_grad_enabled()):
            return super().forward(x)
        with torch.autocast("cpu", enabled=False):
            return super().forward(x.float())
