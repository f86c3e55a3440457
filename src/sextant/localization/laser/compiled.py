"""Loops over particles and beams, as machine code for the CPU."""

from typing import Any

import numba


def compiled(function: Any) -> Any:
    """``function`` as machine code without the interpreter's lock, kept on disk where that is possible."""
    options: Any = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep it: compile in every process
        return numba.njit(**options)(function)
