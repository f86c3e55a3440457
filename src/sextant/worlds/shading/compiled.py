"""Compilation of the shading functions by Numba, kept on disk between processes.

Numba notices changes in the file that defines a function, but not in files that the function calls into. The cache is
therefore kept in a folder named by the hash of this whole package.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config

_SETTINGS: Any = config  # the module gives itself its attributes when it is imported
_HERE = Path(__file__).parent
_SOURCE = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(_HERE.glob("*.py")))).hexdigest()[:12]


def compiled(function: Callable[..., Any]) -> Any:
    """``function`` as machine code: releases the interpreter's lock, keeps IEEE arithmetic (no reordering).

    Arrays inside are not reference-counted: threads that read rows of the same table would compete for its counter,
    which takes a third of the shading time. So no function here may create an array.
    """
    before = _SETTINGS.CACHE_DIR
    if not before:
        _SETTINGS.CACHE_DIR = str(_HERE / "__pycache__" / _SOURCE)
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep it: compile in every process
        return numba.njit(**options)(function)
    finally:
        _SETTINGS.CACHE_DIR = before
