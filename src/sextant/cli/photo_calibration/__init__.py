"""``predict.py`` with a calibration model: photos of any kind to files of their cameras.

Nothing is imported here, and :mod:`~sextant.cli.photo_calibration.options` and
:mod:`~sextant.data.photo_files` import no torch: mistakes in a command are reported at once.
"""
