"""Filters in ``predict.py``: detection from one example, and the classes of images. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.chapters.cosfire.options import PROTOTYPE, DetectionOptions, read_inputs
from sextant.console.written import make_output
from sextant.errors import UserError
from sextant.kit.handler import Handler, Trained, find_run, outputs_of


class Detection(Handler):
    """Detects the pattern of one example in images."""

    task = topic = named_by = "task=cosfire"
    usage = (
        "sextant predict task=cosfire prototype=<image> point=<x,y> input=<image, folder or pattern> output=<folder>"
    )
    keys = PROTOTYPE | DetectionOptions.meanings()
    needs = ("prototype", "input", "output")
    shared = ("task", *Handler.shared)

    def claims(self, given: Mapping[str, str]) -> bool:
        """Whether ``task=cosfire`` is given, and no other task."""
        own = [key for key in self.keys if key in given]
        if own and "task" not in given:
            raise UserError(f"{own[0]}= belongs to task=cosfire", self.usage)
        if given.get("task", "cosfire") != "cosfire":
            raise UserError(
                f"task={given['task']}: only task=cosfire predicts without a run; otherwise run= determines the task",
                f"{Handler.usage}\n{self.usage}",
            )
        return "task" in given

    def predict(self, given: Mapping[str, str]) -> None:
        """Detect the example in the images."""
        inputs = read_inputs(given)
        make_output(inputs.output)
        network = None
        if "run" in given:
            find_run(given)  # before anything heavy is imported
            from sextant.chapters.cosfire.network_image import trained_features

            layer, trust = inputs.options.layer, given.get("trust") == "true"
            network = trained_features(given["run"], outputs_of(given), layer, trust=trust)
        from sextant.chapters.cosfire.predict import predict_detections

        predict_detections(inputs, network)


class Recognition(Handler):
    """Predicts the class of each image by the filters of a run."""

    task = "cosfire"

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Classify images, by the first method of the run."""
        from sextant.chapters.classification.classifier import Answering
        from sextant.chapters.classification.predict import predict_classes
        from sextant.console.console import console
        from sextant.kit.trained import model_from_checkpoint, own_config

        def opened() -> tuple[str, Answering]:
            config = own_config(trained.about, trust=trained.trust)
            module = model_from_checkpoint(config, trained.content, trained.found.checkpoint)
            console.print(f"method {module.estimator.methods[0]}")
            return "score", module.estimator.first_scores

        predict_classes(trained, opened, paths, output, given["input"])


HANDLERS = (Recognition, Detection)
