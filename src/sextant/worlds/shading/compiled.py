"""Compilation of the shading functions by Numba, kept on disk between processes.

Numba notices a change of the file that a function is in, not of the files it calls into. The cache is therefore kept
in a folder named by the hash of this whole package.
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

    Arrays are not reference-counted within: a row of a table that all threads read would have them fight over its
    counter, for a third of the shading time. So no function here may make an array.
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
