"""Correspondences between images: local features, matches, and the geometry that they determine.

Pixels have x to the right and y down, with (0, 0) at the centre of the first pixel. Cameras are pinholes; points of a
camera with distortion are undistorted first. Poses are ``world_from_camera``, x right, y down, z forward.
"""

from sextant.correspondence.absolute_pose import EstimatedPose, absolute_pose
from sextant.correspondence.aliked_features import AlikedFeatures
from sextant.correspondence.conventions import agreement, likely_convention
from sextant.correspondence.features import XFeatures
from sextant.correspondence.left_out import calibrated
from sextant.correspondence.local_features import LocalFeatureExtractor, LocalFeatures, detected
from sextant.correspondence.matching import distinct_matches, epipolar_inliers, mutual_matches
from sextant.correspondence.pinhole import Pinhole
from sextant.correspondence.posed_map import Located, PosedMap, PoseErrors, build_map, focal_length_of, log_false_alarms
from sextant.correspondence.reranking import count_inliers, reranked
from sextant.correspondence.shared_focal import SharedFocalLength, shared_focal_length
from sextant.correspondence.triangulation import Triangulated, triangulate
from sextant.correspondence.trunk_features import TrunkFeatures

__all__ = [
    "AlikedFeatures",
    "EstimatedPose",
    "LocalFeatureExtractor",
    "LocalFeatures",
    "Located",
    "Pinhole",
    "PoseErrors",
    "PosedMap",
    "SharedFocalLength",
    "Triangulated",
    "TrunkFeatures",
    "XFeatures",
    "absolute_pose",
    "agreement",
    "build_map",
    "calibrated",
    "count_inliers",
    "detected",
    "distinct_matches",
    "epipolar_inliers",
    "focal_length_of",
    "likely_convention",
    "log_false_alarms",
    "mutual_matches",
    "reranked",
    "shared_focal_length",
    "triangulate",
]
