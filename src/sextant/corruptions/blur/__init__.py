"""Blur: out of focus, in motion, behind glass."""
