"""Loops that tensors cannot express well, compiled to machine code for the CPU."""

from typing import Any

import numba


def compiled(function: Any, **options: Any) -> Any:
    """Compile ``function`` to machine code that runs without the interpreter's lock; cache it on disk where possible.

    Args:
        function: written in the subset of Python that Numba compiles.
        options: further options of ``numba.njit``, such as ``fastmath``.
    """
    options = {"nogil": True, "error_model": "numpy", **options}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no place for a cache: compile in every process
        return numba.njit(**options)(function)
