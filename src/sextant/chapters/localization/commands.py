"""Localization of images in ``predict.py``. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.applications.arguments import check_apart
from sextant.chapters.localization.found_map import find_map
from sextant.chapters.localization.options import OUTPUT, LocalizingOptions
from sextant.console.written import make_output
from sextant.errors import UserError
from sextant.kit.handler import Handler, Trained, outputs_of


class Localization(Handler):
    """Estimates where images were taken."""

    task = "localization"
    topic = "localization"
    usage = (
        "sextant predict run=<localization run or saved map> input=<folder of photos, video, ROS bag> "
        "[odometry=<table>] [output=localization]"
    )
    keys = LocalizingOptions.meanings()
    needs = ("input",)

    def claims(self, given: Mapping[str, str]) -> bool:
        """Whether ``run=`` names a map, which needs no checkpoint."""
        return "run" in given and find_map(given["run"], outputs_of(given)) is not None

    def predict(self, given: Mapping[str, str]) -> None:
        """Localize images in the map."""
        options = LocalizingOptions.of(given)
        output = Path(given.get("output", OUTPUT)).expanduser()
        folder = find_map(given["run"], outputs_of(given))
        assert folder is not None
        check_apart(output, input=given["input"], run=folder)
        make_output(output)
        from sextant.chapters.localization.predict import predict_poses

        predict_poses(folder, given["input"], output, options, trust=given.get("trust") == "true")

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Refuse a checkpoint without its map."""
        raise UserError(
            f"run={trained.reference}: this localization checkpoint lies outside its run's folder, which contains "
            "the map",
            "Name the run's folder, or a folder that Localizer.save wrote.",
        )


HANDLERS = (Localization,)
