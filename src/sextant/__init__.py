"""Sextant: experiments in computer vision that join geometry with learning.

The package is a functional core (``layers``, ``corruptions``, ``models``, ``evaluation``, ...) that works alone in a
notebook, and a framework around it (``chapters``, ``lifecycle``, ``runs``, ``tracking``, ``reports``, ``cli``) that
runs experiments with it.
Importing ``sextant`` itself imports nothing heavy.
"""

from importlib import import_module
from typing import Any

from sextant.errors import naming_extras
from sextant.moved import keep_old_paths

__version__ = "0.2.0"
keep_old_paths()
APPLICATIONS = ("ExampleDetector", "ImageClassifier", "Localizer", "PhotoCalibrator", "PlaceMap", "PoseMap")
#: names that are imported on first use, and their modules
LAZY = {
    **dict.fromkeys(APPLICATIONS, "sextant.applications"),
    **dict.fromkeys(("run", "sweep", "evaluate"), "sextant.lifecycle.library"),
    **dict.fromkeys(("load_results", "report"), "sextant.lifecycle.results"),
}


def __getattr__(name: str) -> Any:
    """``sextant.Localizer``, ``sextant.run`` and others, imported on first use."""
    if name in LAZY:
        with naming_extras(f"sextant.{name}"):
            return getattr(import_module(LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *LAZY]
