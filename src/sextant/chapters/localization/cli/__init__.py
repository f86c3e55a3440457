"""Localizing the user's own images: ``predict.py`` for task=localization, with the map that a run saves for it."""
