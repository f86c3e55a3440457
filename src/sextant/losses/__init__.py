"""Training losses for camera calibration, by parameters or by the rays of pixels, and for place descriptors.

A calibration loss takes a network's prediction and the ground truth, each ``(b, 4)`` in the numbers of a
:class:`~sextant.geometry.ParameterSpace`, with the aspects of the images, and returns one value per image. A place loss
takes the descriptors of a batch, ``(b, d)``, and which of them show the same place.
"""

from sextant.losses.bearing import BearingLoss
from sextant.losses.camera_loss import CameraLoss
from sextant.losses.contrastive import ContrastiveLoss
from sextant.losses.info_nce import InfoNCELoss
from sextant.losses.multi_similarity import MultiSimilarityLoss
from sextant.losses.parameter import ParameterLoss
from sextant.losses.place_loss import PlaceLoss, PlaceLossOutput
from sextant.losses.pose_lens import PoseLensLoss
from sextant.losses.soft_margin import SoftMarginLoss
from sextant.losses.triplet_margin import TripletMarginLoss
from sextant.losses.triplet_ratio import TripletRatioLoss

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
