"""Searches: which point of a space is tried next, at how many seeds, and with what result."""
