"""Numerical self-checks of calibration on this machine, run by ``sextant doctor calibration``.

Every check computes a number in two ways that share no code where possible (a closed form, bisection, finite
differences, a search along the picture, OpenCV), and gives figures with the limits that they must keep.
"""

from sextant.evaluation.calibration.doctor.checks import examine
from sextant.evaluation.calibration.doctor.crops import Crop
from sextant.evaluation.calibration.doctor.finding import Finding
from sextant.evaluation.calibration.doctor.loss import CrossTalk, cross_talk

__all__ = ["Crop", "CrossTalk", "Finding", "cross_talk", "examine"]
