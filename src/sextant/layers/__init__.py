"""Layers: push-pull inhibition, and surgery that puts it into any network."""

from sextant.layers.push_pull import PushPullConv2d, pull_kernel_size, push_pull, upsample_kernel
from sextant.layers.surgery import NoInhibition, PushPullInhibition, first_conv

__all__ = [
    "NoInhibition",
    "PushPullConv2d",
    "PushPullInhibition",
    "first_conv",
    "pull_kernel_size",
    "push_pull",
    "upsample_kernel",
]
