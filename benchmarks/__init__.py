"""Timings against common alternatives, as ratios within one run: ``python -m benchmarks [name ...]``."""
