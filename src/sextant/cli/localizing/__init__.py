"""Localizing the user's own images: ``predict.py`` for task=localization, and the map that a run keeps for it."""
