"""Training losses: of a calibrated camera, by its parameters or by the rays of its pixels.

A loss of calibration takes what a network predicts and the truth, ``(b, 4)`` each in the numbers of a
:class:`~sextant.geometry.ParameterSpace`, with the aspects of the images, and returns one value an image.
"""

from sextant.losses.bearing import BearingLoss
from sextant.losses.camera_loss import CameraLoss
from sextant.losses.parameter import ParameterLoss

__all__ = ["BearingLoss", "CameraLoss", "ParameterLoss"]
