"""The typed config behind the YAML files: types, ranges, and rules across keys.

Each config that Sextant ships has a model here, chosen by its ``_target_``. The user's own ``_target_`` is legal
everywhere; its arguments are checked against its signature when it is built.
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
