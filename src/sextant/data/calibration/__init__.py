"""Crops of panoramas with cameras drawn from a distribution: the data of single-image calibration."""

from sextant.data.calibration.camera_distributions import CameraDistribution, CameraDraw
from sextant.data.calibration.panorama_folder import PanoramaFolder
from sextant.data.calibration.panoramas import (
    PanoramaMix,
    Panoramas,
    PanoramaSource,
    TownPanoramaSource,
    as_panorama_source,
)

__all__ = [
    "CameraDistribution",
    "CameraDraw",
    "PanoramaFolder",
    "PanoramaMix",
    "PanoramaSource",
    "Panoramas",
    "TownPanoramaSource",
    "as_panorama_source",
]
