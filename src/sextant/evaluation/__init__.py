"""Metrics, protocols and statistics.

What :mod:`~sextant.evaluation.exported` names is found here, and imported when it is asked for: SciPy's statistics take
a second or two of a processor, which whoever needs one module alone is spared.
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
