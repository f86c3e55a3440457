"""``predict.py`` with a calibration model: estimate the cameras of photos of any kind.

Nothing is imported here, and :mod:`~sextant.chapters.calibration.cli.options` and
:mod:`~sextant.data.photo_files` do not import torch, so that mistakes in a command are reported at once.
"""
