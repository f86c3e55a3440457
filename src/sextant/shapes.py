"""The shapes of arguments, checked where arrays of other shapes would be broadcast, cut off or read past their end."""

from types import EllipsisType
from typing import Any

import numpy as np

from sextant.errors import ArgumentError


def check_shape(name: str, value: Any, *shape: int | str | EllipsisType, fix: str | None = None) -> None:
    """Raise an ``ArgumentError`` unless an array, tensor or list has this shape; values are not looked at.

    Sides with a name may be of any length, and ``...`` before them stands for any others.

    >>> check_shape("points", np.zeros((9, 5, 2)), ..., 2)
    >>> try:
    ...     check_shape("poses", np.zeros((5, 2)), "n", 3)
    ... except ArgumentError as error:
    ...     print(error.problem)
    poses has the shape (5, 2), but must have (n, 3)
    """
    found = tuple(value.shape if hasattr(value, "shape") else np.shape(value))
    sides = [side for side in shape if side is not ...]
    last = found[len(found) - len(sides) :] if len(sides) < len(shape) else found
    if len(last) != len(sides) or any(isinstance(a, int) and a != b for a, b in zip(sides, last, strict=True)):
        needed = ", ".join("..." if side is ... else str(side) for side in shape) + "," * (len(shape) == 1)
        raise ArgumentError(f"{name} has the shape {found}, but must have ({needed})", fix)
