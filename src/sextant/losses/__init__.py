"""Training losses: of a calibrated camera, by its parameters or by the rays of its pixels; of place descriptors.

A loss of calibration takes what a network predicts and the truth, ``(b, 4)`` each in the numbers of a
:class:`~sextant.geometry.ParameterSpace`, with the aspects of the images, and returns one value an image. A loss of
places takes the descriptors of a batch, ``(b, d)``, and which of them show one place.
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
