"""Localization of a camera: maps of descriptors at known poses, observation models over poses, and filters."""
