"""What users do with a trained model: classify images, localize a robot, calibrate, match and detect.

No console, and no imports of Hydra, Lightning or MLflow. Errors are raised as :class:`sextant.errors.UserError`.
"""

from importlib import import_module
from typing import Any

_HERE = {
    "Classified": "sextant.applications.classification",
    "Detection": "sextant.applications.detection.detector",
    "ExampleDetector": "sextant.applications.detection.detector",
    "FailedPhoto": "sextant.applications.failures",
    "FailedPhotosError": "sextant.applications.failures",
    "ImageClassifier": "sextant.applications.classification",
    "LocalizedPose": "sextant.applications.localization.localizer",
    "Localizer": "sextant.applications.localization.localizer",
    "LookedUp": "sextant.applications.places.looked_up",
    "OneCamera": "sextant.applications.calibration.one_camera",
    "PhotoCalibrator": "sextant.applications.calibration.calibrator",
    "PhotoCamera": "sextant.applications.calibration.photo_camera",
    "PlaceMap": "sextant.applications.places.place_map",
    "PlaceMatch": "sextant.applications.places.looked_up",
}
__all__ = list(_HERE)


def __getattr__(name: str) -> Any:
    """An application, imported on first use."""
    if name in _HERE:
        return getattr(import_module(_HERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
