"""Localization in a map of images by Gaussian processes in a particle filter (chapters 4 and 5)."""
