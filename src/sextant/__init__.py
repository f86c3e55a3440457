"""Sextant: experiments in computer vision that join geometry with learning.

The package is a functional core (``layers``, ``corruptions``, ``models``, ``evaluation``, ...) that works alone in a
notebook, and a frame around it (``tasks``, ``runs``, ``tracking``, ``reports``, ``cli``) that makes experiments of it.
Importing ``sextant`` itself imports nothing heavy.
"""

from importlib import import_module

__version__ = "0.1.0"
APPLICATIONS = ("ImageClassifier", "Localizer")


def __getattr__(name: str) -> object:
    """``sextant.Localizer`` and other applications, imported when they are asked for."""
    if name in APPLICATIONS:
        return getattr(import_module("sextant.applications"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
