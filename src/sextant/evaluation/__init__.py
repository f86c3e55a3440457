"""Metrics, protocols and statistics.

The names in :mod:`~sextant.evaluation.exported` are available here, and imported lazily: importing SciPy's statistics
takes a second or two, which users of a single module are spared.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sextant.evaluation.exported import *  # noqa: F403
else:

    def __getattr__(name: str) -> Any:
        exported = import_module("sextant.evaluation.exported")
        if name in exported.__all__:
            return getattr(exported, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
