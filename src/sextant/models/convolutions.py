"""Convolutions with normalisation and activation, and depthwise convolutions."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

GROUP = 8


def convolutions(channels: int, widths: tuple[int, ...], strides: tuple[int, ...]) -> nn.Sequential:
    """3x3 convolutions, each followed by group normalisation in groups of eight channels and ReLU.

    Group normalisation treats each image alone, so that batches may be of any size and mix conditions.

    Source: Y. Wu, K. He, "Group normalization", ECCV 2018.

    Args:
        channels: channels of the input.
        widths: channels of the layers, multiples of 8.
        strides: strides of the layers.

    Raises:
        ValueError: a width is not a multiple of 8, or widths and strides differ in number.

    Example:
        >>> import torch
        >>> convolutions(3, (8, 16), (1, 2))(torch.rand(2, 3, 12, 16)).shape
        torch.Size([2, 16, 6, 8])
    """
    if any(width % GROUP for width in widths):
        raise ValueError(f"widths must be multiples of {GROUP}, got {tuple(widths)}")
    if len(widths) != len(strides):
        raise ValueError(f"{len(widths)} widths need as many strides, got {tuple(strides)}")
    layers: list[nn.Module] = []
    for before, width, stride in zip((channels, *widths), widths, strides, strict=False):
        layers += [
            nn.Conv2d(before, width, 3, stride, padding=1, bias=False),
            nn.GroupNorm(width // GROUP, width),
            nn.ReLU(inplace=True),
        ]
    return nn.Sequential(*layers)


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
