"""Layers: push-pull inhibition, anti-aliased pooling, and surgery that puts them into any network."""

from sextant.layers.blur_pool import (
    AntiAliasing,
    BlurPool2d,
    anti_alias,
    anti_aliased_conv,
    anti_aliased_pool,
    blur_pool,
)
from sextant.layers.fold import fold
from sextant.layers.inhibition import (
    NoInhibition,
    PushPullAvgInhibition,
    PushPullInhibition,
    implementations,
    inhibit,
    inhibited,
    skipped,
)
from sextant.layers.network_stages import first_stage_convs
from sextant.layers.push_pull import PushPullConv2d, push_pull
from sextant.layers.push_pull_avg import PushPullAvgConv2d, push_pull_avg
from sextant.layers.strength import interpolation_matrix, pull_kernel_size, strength_path, upsample_kernel
from sextant.layers.surgery import Conversion, Rule, convert, first_conv

__all__ = [
    "AntiAliasing",
    "BlurPool2d",
    "Conversion",
    "NoInhibition",
    "PushPullAvgConv2d",
    "PushPullAvgInhibition",
    "PushPullConv2d",
    "PushPullInhibition",
    "Rule",
    "anti_alias",
    "anti_aliased_conv",
    "anti_aliased_pool",
    "blur_pool",
    "convert",
    "first_conv",
    "first_stage_convs",
    "fold",
    "implementations",
    "inhibit",
    "inhibited",
    "interpolation_matrix",
    "pull_kernel_size",
    "push_pull",
    "push_pull_avg",
    "skipped",
    "strength_path",
    "upsample_kernel",
]
