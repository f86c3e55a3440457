"""The families of method: what the life cycle of a run asks of each task."""

from sextant.cli.families.family import Family, Source


def family_of(task: str) -> Family:
    """The family of ``task.name``."""
    if task == "calibration":
        from sextant.cli.families.calibration import CalibrationFamily

        return CalibrationFamily()
    if task == "place_recognition":
        from sextant.cli.families.place_recognition import PlaceRecognitionFamily

        return PlaceRecognitionFamily()
    if task == "localization":
        from sextant.cli.families.localization import LocalizationFamily

        return LocalizationFamily()
    if task == "cosfire":
        from sextant.cli.families.cosfire import CosfireFamily

        return CosfireFamily()
    from sextant.cli.families.classification import ClassificationFamily

    return ClassificationFamily()


__all__ = ["Family", "Source", "family_of"]
