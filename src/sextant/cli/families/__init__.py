"""The families of method: what the life cycle of a run asks of each task."""

from sextant.cli.families.family import Family, Source
from sextant.config import Config


def family_of(config: Config) -> Family:
    """The family that ``config.task`` belongs to."""
    if config.task.name == "calibration":
        from sextant.cli.families.calibration import CalibrationFamily

        return CalibrationFamily()
    from sextant.cli.families.classification import ClassificationFamily

    return ClassificationFamily()


__all__ = ["Family", "Source", "family_of"]
