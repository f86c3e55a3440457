"""The convolutional layers that the small networks share.

Group normalisation treats each image alone, so that batches may be of any size and mix conditions.

Source: Y. Wu, K. He, "Group normalization", ECCV 2018.
"""

from torch import nn

GROUP = 8


def convolutions(channels: int, widths: tuple[int, ...], strides: tuple[int, ...]) -> nn.Sequential:
    """3x3 convolutions, each followed by group normalisation in groups of eight channels and ReLU.

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
