"""Crops of panoramas with cameras drawn from a distribution: the data of single-image calibration.

Camera distributions need torch, which is imported when one is first used; sources of panoramas do not need it.
"""

from typing import TYPE_CHECKING, Any

from sextant.chapters.calibration.data.panorama_folder import PanoramaFolder
from sextant.chapters.calibration.data.panoramas import (
    PanoramaMix,
    Panoramas,
    PanoramaSource,
    TownPanoramaSource,
    as_panorama_source,
)

if TYPE_CHECKING:
    from sextant.chapters.calibration.data.camera_distributions import CameraDistribution, CameraDraw

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


def __getattr__(name: str) -> Any:
    if name in ("CameraDistribution", "CameraDraw"):
        from sextant.chapters.calibration.data import camera_distributions

        return getattr(camera_distributions, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
