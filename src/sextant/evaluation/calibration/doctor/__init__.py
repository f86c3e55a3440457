"""Whether the mathematics of calibration holds on this machine: what ``sextant doctor calibration`` runs.

Every check compares two ways to one number that share no code where that is possible (a closed form, bisection, finite
differences, a search along the picture, OpenCV), and gives figures with the limits that they have to keep.
"""

from sextant.evaluation.calibration.doctor.checks import examine
from sextant.evaluation.calibration.doctor.crops import Crop
from sextant.evaluation.calibration.doctor.finding import Finding
from sextant.evaluation.calibration.doctor.loss import CrossTalk, cross_talk

__all__ = ["Crop", "CrossTalk", "Finding", "cross_talk", "examine"]
