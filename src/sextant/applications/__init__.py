"""Applications of trained models: classify images, localize a robot, calibrate photos, match places, detect patterns.

They print nothing and import no Hydra, Lightning or MLflow. Errors are raised as :class:`sextant.errors.UserError`.
"""

from importlib import import_module
from typing import Any

_HERE = {
    "Classified": "sextant.chapters.classification.classifier",
    "Detection": "sextant.chapters.cosfire.detector",
    "ExampleDetector": "sextant.chapters.cosfire.detector",
    "FailedPhoto": "sextant.applications.failures",
    "FailedPhotosError": "sextant.applications.failures",
    "ImageClassifier": "sextant.chapters.classification.classifier",
    "LocatedPhoto": "sextant.chapters.localization.pose_map",
    "LocalizedPose": "sextant.chapters.localization.localized_pose",
    "Localizer": "sextant.chapters.localization.localizer",
    "LookedUp": "sextant.chapters.places.looked_up",
    "OneCamera": "sextant.chapters.calibration.one_camera",
    "PhotoCalibrator": "sextant.chapters.calibration.calibrator",
    "PhotoCamera": "sextant.chapters.calibration.photo_camera",
    "PhotoNetwork": "sextant.chapters.calibration.other_networks",
    "PlaceMap": "sextant.chapters.places.place_map",
    "PlaceMatch": "sextant.chapters.places.looked_up",
    "PoseMap": "sextant.chapters.localization.pose_map",
}
__all__ = list(_HERE)


def __getattr__(name: str) -> Any:
    """An application, imported on first use."""
    if name in _HERE:
        return getattr(import_module(_HERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
