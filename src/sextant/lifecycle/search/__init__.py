"""Searches: the choice of points in a space, their seeds and their results."""
