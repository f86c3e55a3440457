"""Recall, precision and posteriors of place recognition."""
