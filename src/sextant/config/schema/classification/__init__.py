"""Schemas of classification under corruptions."""
