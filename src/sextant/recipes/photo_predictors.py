"""Models that were registered by earlier releases hold a copy of code that imports this module."""

from sextant.lifecycle.offered import photo_predictor

__all__ = ["photo_predictor"]
