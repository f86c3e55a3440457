"""The type of images and maps, of which whole numbers would round the weights of a filter."""

import torch
from torch import Tensor

from sextant.errors import ArgumentError


def require_floating(values: Tensor, what: str = "images") -> Tensor:
    """``values`` if they are floating-point.

    Raises:
        ArgumentError: they are not.
    """
    if not values.is_floating_point():
        scaled = " / 255" if values.dtype == torch.uint8 else ""
        raise ArgumentError(f"need floating-point {what}, got {values.dtype}", f"Give {what}.float(){scaled}.")
    return values
