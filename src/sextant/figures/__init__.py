"""Figures from arrays; each function returns a matplotlib figure and writes nothing."""
