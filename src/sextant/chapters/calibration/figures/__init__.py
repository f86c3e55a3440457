"""Figures of cameras and of their errors."""
