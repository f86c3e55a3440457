"""``predict.py`` with a calibration model: from photos of any kind to their cameras, with all that can be said of them.

The network sees the largest centred part of a photo that has an aspect it was trained on; what it finds is told in
pixels of the whole upright original. Where a focal length is known beforehand, or photos are of one camera, the
estimates are fused at fixed appearance: the apparent distortion ``k1 / f²`` and the seen offset of the horizon stay, so
that k1 and tilt follow the new focal length.

Nothing is imported here, and :mod:`~sextant.cli.photo_calibration.options` and
:mod:`~sextant.data.photo_files` import no torch: mistakes in a command are told at once.
"""
