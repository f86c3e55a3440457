"""Eight-bit images as the benchmark files hold them.

The authors of CIFAR-10-C and ImageNet-C cast 255 y to ``uint8``, which drops the fraction, so that their files are on
average half a grey level darker than y. The correct rounding, to the nearest, is that of ``corrected``.
"""

from typing import get_args

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from sextant.corruptions.benchmark_corruption import Mode
from sextant.corruptions.contract import scaling
from sextant.errors import ArgumentError

# 255 · (k / 255) in float32, blurred or not, may fall short of k by some 1e-5, which must not cost a grey level
SLACK = 2e-4


def to_bytes(images: Float[Tensor, "*shape"], mode: Mode = "faithful") -> UInt8[Tensor, "*shape"]:
    """``images`` in [0, 1] as bytes: ``⌊255 y⌋`` in faithful mode, the nearest to ``255 y`` in corrected mode.

    Values are not checked: nan has no byte.

    Raises:
        ArgumentError: there is no such mode, or the images are not floating-point.

    >>> to_bytes(torch.tensor([0.0, 0.501, 1.0]))
    tensor([  0, 127, 255], dtype=torch.uint8)
    >>> to_bytes(torch.tensor([0.0, 0.501, 1.0]), "corrected")
    tensor([  0, 128, 255], dtype=torch.uint8)
    """
    if mode not in get_args(Mode):
        raise ArgumentError(f"mode={mode} is not known; it is {' or '.join(get_args(Mode))}")
    _require_floating(images)
    scaled = images.to(torch.promote_types(images.dtype, torch.float32)) * 255
    whole = scaled.add_(SLACK) if mode == "faithful" else scaled.round_()
    return whole.clamp_(0, 255).to(torch.uint8)  # the cast drops the fraction


def eight_bit(images: Float[Tensor, "*shape"], mode: Mode = "faithful") -> Float[Tensor, "*shape"]:
    """``images`` with the 256 values that :func:`to_bytes` leaves, in [0, 1]; it raises the same errors.

    >>> eight_bit(torch.tensor([0.0, 0.501, 1.0]))
    tensor([0.0000, 0.4980, 1.0000])
    """
    whole = to_bytes(images, mode)
    return (whole.to(torch.promote_types(images.dtype, torch.float32)) / 255).to(images.dtype)


#: weights of red, green and blue in ITU-R BT.601, which Pillow's ``L`` and OpenCV's grey conversion use
WEIGHTS = (0.299, 0.587, 0.114)


def luma(images: Float[Tensor, "*batch c h w"]) -> Float[Tensor, "*batch 1 h w"]:
    """``0.299 R + 0.587 G + 0.114 B``; an image of one channel is its own luma.

    Raises:
        ValueError: the images have neither one channel nor three.
        ArgumentError: they are not floating-point.
    """
    _require_floating(images)
    channels = images.shape[-3]
    if channels == 1:
        return images
    if channels != 3:
        raise ValueError(f"images have 1 or 3 channels, not {channels}")
    return (images * images.new_tensor(WEIGHTS)[:, None, None]).sum(-3, keepdim=True)


def _require_floating(images: Tensor) -> None:
    if not images.is_floating_point():
        raise ArgumentError(f"images hold {images.dtype}, not floating-point values in [0, 1]", scaling(images.dtype))
