"""The typed config behind the YAML files: types, ranges and rules that join several keys.

Each config that Sextant ships has a model here, chosen by its ``_target_``. A ``_target_`` of the user's own is legal
everywhere: its arguments are then checked against its signature when it is built.
"""

from sextant.config.schema.run import Config
from sextant.config.schema.tasks import (
    CalibrationTask,
    ClassificationTask,
    CosfireTask,
    LocalizationTask,
    PlaceRecognitionTask,
)

__all__ = [
    "CalibrationTask",
    "ClassificationTask",
    "Config",
    "CosfireTask",
    "LocalizationTask",
    "PlaceRecognitionTask",
]
