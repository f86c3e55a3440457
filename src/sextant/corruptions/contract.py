"""The inputs of a corruption: batches of grey or colour images in [0, 1], each with its position in a dataset."""

import operator
from collections.abc import Sequence
from typing import TypeAlias

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.errors import UserError, shown
from sextant.tables import counted

CHANNELS = (1, 3)
DTYPES = (torch.float16, torch.bfloat16, torch.float32, torch.float64)
Images: TypeAlias = Float[Tensor, "b c h w"]
#: positions of images in their dataset, from 0
Positions: TypeAlias = Int64[Tensor, "b"]
#: positions as they may be given; a single number for a single image
Indices: TypeAlias = Positions | Sequence[int] | int


def require_images(images: Tensor) -> None:
    """Raise a ``UserError`` unless ``images`` are ``(b, c, h, w)``, grey or colour, floating, and within [0, 1].

    Values are read once. A batch may be empty, an image may not.
    """
    if not isinstance(images, Tensor):
        raise UserError(
            f"images are a {type(images).__name__}, not a tensor of shape (b, c, h, w)",
            "sextant.corruptions.corrupt takes NumPy arrays and Pillow images.",
        )
    shape = tuple(images.shape)
    if images.ndim != 4 or shape[1] not in CHANNELS or 0 in shape[2:]:
        raise UserError(f"images have the shape {shape}, not (b, c, h, w) with 1 or 3 channels", _reshaping(shape))
    if images.dtype not in DTYPES:
        raise UserError(f"images hold {images.dtype}, not floating-point values in [0, 1]", scaling(images.dtype))
    if len(images) == 0:
        return
    low, high = (bound.item() for bound in images.detach().aminmax())
    if not (low >= 0 and high <= 1):  # a nan is neither
        if not (images.isfinite().all()):
            raise UserError("images contain NaN or infinite values", "Values must be within [0, 1].")
        raise UserError(
            f"images hold values from {low:g} to {high:g}, which are not within [0, 1]",
            "Divide by 255." if low >= 0 and 1 < high <= 255 else "Scale them, or cut them off: images.clamp(0, 1).",
        )


def require_indices(indices: Indices, count: int) -> Positions:
    """``indices`` as a tensor on the CPU, if they are one non-negative whole number for each of ``count`` images.

    Raises:
        UserError: they are anything else.
    """
    advice = f"One whole number from 0 on for each image, its position in the dataset, such as torch.arange({count})."
    try:
        found = torch.as_tensor(indices).detach().cpu()
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise UserError(f"indices={shown(indices)} are not whole numbers", advice) from None
    if found.numel() == 0:
        found = found.long()  # an empty list becomes floating-point
    if found.dtype == torch.bool or found.is_floating_point() or found.is_complex():
        raise UserError(f"indices hold {found.dtype}, not whole numbers", advice)
    if found.numel() != count or found.ndim > 1:
        raise UserError(f"indices have the shape {tuple(found.shape)} for {counted(count, 'image')}", advice)
    found = found.long().reshape(count)
    if bool((found < 0).any()):
        raise UserError(f"indices reach down to {int(found.min())}", advice)
    return found


def require_seed(seed: int) -> int:
    """``seed`` if it is a whole number.

    Raises:
        UserError: it is anything else, whose conversion would silently change the seed.
    """
    try:
        return int(operator.index(seed))
    except TypeError:
        raise UserError(f"seed={seed!r} is not a whole number") from None


def _reshaping(shape: tuple[int, ...]) -> str:
    if 0 in shape[-2:]:
        return "An image needs pixels."
    if len(shape) == 4 and shape[-1] in CHANNELS:
        return "Channels come second: images.permute(0, 3, 1, 2)."
    if len(shape) == 3 and shape[0] in CHANNELS:
        return "One image is a batch of one: images[None]."
    if len(shape) == 3 and shape[-1] in CHANNELS:
        return "One image is a batch of one, and channels come second: images.permute(2, 0, 1)[None]."
    return "Grey images are (b, 1, h, w), colour images (b, 3, h, w)."


def scaling(dtype: torch.dtype) -> str:
    """How images of this type become floating-point values in [0, 1], for an error message."""
    if dtype == torch.uint8:
        return "Bytes become such values by images.float() / 255; sextant.corruptions.corrupt takes bytes (b, h, w, c)."
    return "Convert them to values within [0, 1]."
