"""Sextant: experiments in computer vision that join geometry with learning.

The package is a functional core (``layers``, ``corruptions``, ``models``, ``evaluation``, ...) that works alone in a
notebook, and a frame around it (``tasks``, ``runs``, ``tracking``, ``reports``, ``cli``) that makes experiments of it.
Importing ``sextant`` itself imports nothing heavy.
"""

__version__ = "0.1.0"
