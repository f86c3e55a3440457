"""Localizing the user's own images: what a map keeps beside its model, and ``predict.py`` for task=localization."""
