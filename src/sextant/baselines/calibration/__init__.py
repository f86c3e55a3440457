"""Geometric calibration: baselines of networks, and the line evidence that refines their predictions.

Every method has ``fit(cameras)``, which learns a prior from training labels only, ``calibrate(image)`` and
``calibrate_many(images)``. All are deterministic.
"""

from sextant.baselines.calibration.combined import CombinedGeometry, detect_bent_segments
from sextant.baselines.calibration.constant import ConstantCamera, PriorCamera
from sextant.baselines.calibration.edge_chains import detect_chains
from sextant.baselines.calibration.estimate import (
    CalibrationBaseline,
    CalibrationEstimate,
    CameraPrior,
    Determined,
    camera_of_vector,
    prior_of_cameras,
    stack_cameras,
)
from sextant.baselines.calibration.joint import JointEstimate, joint_estimate
from sextant.baselines.calibration.line_evidence import LineEvidence
from sextant.baselines.calibration.line_segments import count_long, detect_segments
from sextant.baselines.calibration.observed import Observed, ObservedField, ObservedRays, map_points
from sextant.baselines.calibration.plumb_line import PlumbLine
from sextant.baselines.calibration.robust_fit import FOCAL_HEIGHTS
from sextant.baselines.calibration.terms import CameraBelief, FocalBelief, GravityBelief, PhotoPrior, Term
from sextant.baselines.calibration.vanishing_points import VanishingPoints

__all__ = [
    "FOCAL_HEIGHTS",
    "CalibrationBaseline",
    "CalibrationEstimate",
    "CameraBelief",
    "CameraPrior",
    "CombinedGeometry",
    "ConstantCamera",
    "Determined",
    "FocalBelief",
    "GravityBelief",
    "JointEstimate",
    "LineEvidence",
    "Observed",
    "ObservedField",
    "ObservedRays",
    "PhotoPrior",
    "PlumbLine",
    "PriorCamera",
    "Term",
    "VanishingPoints",
    "camera_of_vector",
    "count_long",
    "detect_bent_segments",
    "detect_chains",
    "detect_segments",
    "joint_estimate",
    "map_points",
    "prior_of_cameras",
    "stack_cameras",
]
