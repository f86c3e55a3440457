"""Schemas of place recognition."""
