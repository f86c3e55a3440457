"""Training losses for camera calibration, by parameters or by the rays of pixels, and for place descriptors.

A calibration loss takes a network's prediction and the ground truth, each ``(b, 4)`` in the numbers of a
:class:`~sextant.geometry.ParameterSpace`, with the aspects of the images, and returns one value per image. A place loss
takes the descriptors of a batch, ``(b, d)``, and which of them show the same place.
"""

from sextant.losses.camera_losses import BearingLoss, CameraLoss, ParameterLoss, PoseLensLoss
from sextant.losses.place_losses import (
    ContrastiveLoss,
    InfoNCELoss,
    MultiSimilarityLoss,
    PlaceLoss,
    PlaceLossOutput,
    SoftMarginLoss,
    TripletMarginLoss,
    TripletRatioLoss,
)

__all__ = [
    "BearingLoss",
    "CameraLoss",
    "ContrastiveLoss",
    "InfoNCELoss",
    "MultiSimilarityLoss",
    "ParameterLoss",
    "PlaceLoss",
    "PlaceLossOutput",
    "PoseLensLoss",
    "SoftMarginLoss",
    "TripletMarginLoss",
    "TripletRatioLoss",
]
