"""Noise: sensor and transmission noise, each pixel on its own."""
