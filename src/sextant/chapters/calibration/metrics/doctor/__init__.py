"""Numerical self-checks of calibration on this machine, run by ``sextant doctor calibration``.

Every check computes a number in two ways that share no code where possible (a closed form, bisection, finite
differences, a search along the picture, OpenCV), and returns figures with their limits.
"""

from sextant.chapters.calibration.metrics.doctor.checks import examine
from sextant.chapters.calibration.metrics.doctor.finding import Crop, Finding
from sextant.chapters.calibration.metrics.doctor.loss import CrossTalk, cross_talk

__all__ = ["Crop", "CrossTalk", "Finding", "cross_talk", "examine"]
