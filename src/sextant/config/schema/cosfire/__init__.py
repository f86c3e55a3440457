"""Schemas of COSFIRE filters."""
