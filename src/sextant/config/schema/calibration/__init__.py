"""Schemas of camera calibration."""
