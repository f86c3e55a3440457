"""Localization (chapters 4 and 5): modules, validation, test and report."""
