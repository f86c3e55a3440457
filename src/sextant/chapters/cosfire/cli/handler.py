"""The ``predict.py`` handler for detection from one example."""

from collections.abc import Mapping

from sextant.chapters.cosfire.cli.inputs import read_inputs
from sextant.chapters.cosfire.cli.options import PROTOTYPE, DetectionOptions
from sextant.console.output_folder import make_output
from sextant.errors import UserError
from sextant.kit.handler import Handler, find_run, outputs_of


class Detection(Handler):
    """Detects in images what one example shows."""

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
                f"task={given['task']}: only task=cosfire predicts without a run; any other task is that of run=",
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
        from sextant.chapters.cosfire.cli.predict import predict_detections

        predict_detections(inputs, network)
