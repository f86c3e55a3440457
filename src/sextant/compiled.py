"""Loops that tensors cannot express well, as machine code for the CPU."""

from typing import Any

import numba


def compiled(function: Any, **options: Any) -> Any:
    """``function`` as machine code without the interpreter's lock, kept on disk where that is possible.

    Args:
        function: in what Numba compiles.
        options: further ones of ``numba.njit``, such as ``fastmath``.
    """
    options = {"nogil": True, "error_model": "numpy", **options}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep it: compile in every process
        return numba.njit(**options)(function)
