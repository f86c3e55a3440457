"""Schemas of localization."""
