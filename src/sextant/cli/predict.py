"""``predict.py``: classify images, calibrate photos, look photos up or localize them in a map, detect an example.

What is heavy is imported where it is used, so that mistakes in a command are told at once.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sextant.applications.calibration.options import CalibrationOptions
from sextant.atomic_files import write_csv, write_json
from sextant.cli.arguments import parse_arguments
from sextant.cli.console import console
from sextant.cli.cosfire_detection.inputs import read_inputs as read_detection_inputs
from sextant.cli.cosfire_detection.options import KEYS as DETECTION_KEYS
from sextant.cli.localizing.options import KEYS as LOCALIZING_KEYS
from sextant.cli.localizing.options import OUTPUT as LOCALIZATION_OUTPUT
from sextant.cli.localizing.options import localization_map
from sextant.cli.localizing.options import options_from as localizing_options
from sextant.cli.output_folder import telling_write_errors
from sextant.cli.photo_calibration.options import KEYS as CALIBRATION_KEYS
from sextant.cli.photo_calibration.options import options_from
from sextant.cli.place_matching.options import INPUTS as PLACE_INPUTS
from sextant.cli.place_matching.options import KEYS as PLACE_KEYS
from sextant.cli.skipped_files import skipped_table
from sextant.data.image_folder import decode_square
from sextant.data.photo_files import find_photos
from sextant.data.unusable_files import nothing_usable
from sextant.errors import UserError
from sextant.runs.resolve import FoundRun, resolve_run
from sextant.tracking.environment import quiet_libraries

if TYPE_CHECKING:
    from torch import Tensor

    from sextant.config import Config

USAGE = (
    "python predict.py run=<MLflow run id, run directory or checkpoint> input=<image, folder or pattern> "
    "output=<folder>"
)
PLACE_USAGE = "python predict.py run=<...> map=<folder> queries=<folder> [output=matches]"
LOCALIZING_USAGE = (
    "python predict.py run=<run of localization, or a saved map> input=<folder of photos, or video> "
    "[odometry=<table>] [output=localization]"
)
DETECTION_USAGE = (
    "python predict.py task=cosfire prototype=<image> point=<x,y> input=<image, folder or pattern> output=<folder>"
)
KEYS = {
    "run": "the trained model",
    "task": "cosfire: detect what one example shows, with the features of run= or without; other tasks come with run=",
    "input": "an image, a folder that is searched for images, or a pattern such as 'photos/*.jpg'; for localization "
    "also a video",
    "output": "folder for what is found: tables (CSV, JSON) and pictures; with map=, matches unless given; for "
    "localization, localization unless given",
    "outputs": "output folder of runs, if not the default",
    "trust": "true: build parts of the user's own that the checkpoint names",
    **{key: f"calibration: {text}" for key, text in CALIBRATION_KEYS.items()},
    **{key: f"places: {text}" for key, text in (PLACE_INPUTS | PLACE_KEYS).items()},
    **{key: f"localization: {text}" for key, text in LOCALIZING_KEYS.items()},
    **{key: f"task=cosfire: {text}" for key, text in DETECTION_KEYS.items()},
}
BATCH = 256
SHEET = 40


def main(arguments: Sequence[str]) -> None:
    """Predict every image; one that cannot be read is named in the result and the rest go on."""
    quiet_libraries()
    given = parse_arguments(arguments, KEYS, f"{USAGE}\n{PLACE_USAGE}\n{LOCALIZING_USAGE}\n{DETECTION_USAGE}")
    if "task" in given or any(key in given for key in DETECTION_KEYS):
        _detect(given)
        return
    if any(key in given for key in PLACE_INPUTS):
        _match_places(given)
        return
    if "run" in given and (where := localization_map(given["run"], _outputs(given))) is not None:
        _localize(given, where)
        return
    _require(given, ("run", "input", "output"), USAGE)
    output = Path(given["output"]).expanduser()
    options = options_from(given)
    paths = find_photos(given["input"], output)
    _make(output)
    found = _find_run(given)
    from sextant.runs.checkpoint import KEY
    from sextant.trained.content import read_trained

    content = read_trained(found.checkpoint)
    trained = content[KEY]
    if trained["task"] == "place_recognition":
        raise UserError(
            f"run={given['run']}: input= does not take models of place_recognition, which look photos up in a map",
            PLACE_USAGE,
        )
    _refuse(given, PLACE_KEYS, "place_recognition", trained["task"])
    _refuse(given, LOCALIZING_KEYS, "localization", trained["task"])
    trust = given.get("trust") == "true"
    if trained["task"] == "localization":
        raise UserError(
            f"run={given['run']}: this checkpoint of localization lies outside of its run's folder, which has the map",
            "Name the run's folder, or a folder that Localizer.save wrote.",
        )
    if trained["task"] == "calibration":
        _calibrate(content, found.checkpoint, paths, output, options, trust)
        return
    _refuse(given, CALIBRATION_KEYS, "calibration", trained["task"])
    rows, pictures = _classify(paths, content, found.checkpoint, trust)
    with telling_write_errors(output):
        _write(rows, output)
        _sheet(pictures, output)
    skipped = {row["file"]: row["error"] for row in rows if "error" in row}
    if len(skipped) == len(rows):
        raise nothing_usable(f"input={given['input']}: none of {len(rows):,} images could be read", skipped)
    if skipped:
        console.print(skipped_table(skipped))
    console.print(
        f"{len(rows) - len(skipped)} images classified"
        + (f", [red]{len(skipped)} could not be read[/]" if skipped else "")
    )
    console.print(f"{output}/predictions.csv\n{output}/predictions.json\n{output}/predictions.png")


def _require(given: Mapping[str, str], keys: Sequence[str], usage: str) -> None:
    for key in keys:
        if key not in given:
            raise UserError(f"{key}= is missing", usage)


def _refuse(given: Mapping[str, str], keys: Iterable[str], task: str, trained: str) -> None:
    """Raise a ``UserError`` if one of ``keys``, which belong to ``task``, is given to a model of another."""
    if chosen := [key for key in keys if key in given]:
        raise UserError(f"{chosen[0]}= belongs to {task}; this is a model of {trained}", USAGE)


def _make(output: Path) -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"output={output} is not a folder that can be written to: {error.strerror}") from None


def _find_run(given: Mapping[str, str]) -> FoundRun:
    return resolve_run(given["run"], _outputs(given))


def _outputs(given: Mapping[str, str]) -> Path:
    if "outputs" in given:
        return Path(given["outputs"]).absolute()
    from sextant.runs.outputs_folder import default_outputs

    return default_outputs()


def _detect(given: Mapping[str, str]) -> None:
    if "task" not in given:
        raise UserError(f"{next(k for k in DETECTION_KEYS if k in given)}= belongs to task=cosfire", DETECTION_USAGE)
    if given["task"] != "cosfire":
        raise UserError(
            f"task={given['task']}: only task=cosfire predicts without a run; any other task is that of run=",
            f"{USAGE}\n{DETECTION_USAGE}",
        )
    if others := [k for k in given if k in PLACE_INPUTS | PLACE_KEYS | CALIBRATION_KEYS | LOCALIZING_KEYS]:
        raise UserError(f"{others[0]}= does not go with task=cosfire", DETECTION_USAGE)
    _require(given, ("prototype", "input", "output"), DETECTION_USAGE)
    inputs = read_detection_inputs(given)
    _make(inputs.output)
    if "run" in given:
        _find_run(given)  # before anything heavy is imported
    from sextant.cli.cosfire_detection.predict import predict_detections

    network = None
    if "run" in given:
        from sextant.applications.detection.network import trained_features

        layer, trust = inputs.options.layer, given.get("trust") == "true"
        network = trained_features(given["run"], _outputs(given), layer, trust=trust)
    predict_detections(inputs, network)


def _localize(given: Mapping[str, str], folder: Path) -> None:
    _require(given, ("input",), LOCALIZING_USAGE)
    for keys, task in ((PLACE_KEYS, "place_recognition"), (CALIBRATION_KEYS, "calibration")):
        _refuse(given, keys, task, "localization")
    options = localizing_options(given)
    output = Path(given.get("output", LOCALIZATION_OUTPUT)).expanduser()
    _make(output)
    from sextant.cli.localizing.predict import predict_poses

    predict_poses(folder, given["input"], output, options, trust=given.get("trust") == "true")


def _calibrate(
    content: Mapping[str, Any],
    checkpoint: Path,
    paths: list[Path],
    output: Path,
    options: CalibrationOptions,
    trust: bool,
) -> None:
    from sextant.applications.calibration.model import TrainedModel
    from sextant.cli.photo_calibration.predict import predict_calibrations
    from sextant.recipes.trained_model import model_from_checkpoint
    from sextant.runs.checkpoint import KEY
    from sextant.trained.content import own_config

    raw, config = own_config(content[KEY], trust=trust)
    module = model_from_checkpoint(raw, config, content, checkpoint)
    predict_calibrations(TrainedModel(module), paths, output, options)


def _match_places(given: Mapping[str, str]) -> None:
    from sextant.cli.place_matching.inputs import read_inputs

    _require(given, ("run", *PLACE_INPUTS), PLACE_USAGE)
    if chosen := [key for key in ("input", *CALIBRATION_KEYS) if key in given]:
        raise UserError(f"{chosen[0]}= does not go with map= and queries=", PLACE_USAGE)
    inputs = read_inputs(given)
    _make(inputs.output)
    found = _find_run(given)
    from sextant.runs.checkpoint import KEY
    from sextant.trained.content import read_trained

    content = read_trained(found.checkpoint)
    trained = content[KEY]
    if trained["task"] != "place_recognition":
        raise UserError(f"map= belongs to place_recognition; this is a model of {trained['task']}", USAGE)
    from sextant.applications.places.run_facts import run_facts, run_temperature
    from sextant.cli.place_matching.predict import predict_places
    from sextant.config.schema import PlaceRecognitionTask
    from sextant.trained.content import own_config
    from sextant.trained.place_network import trained_place_network

    trust = given.get("trust") == "true"
    _, config = own_config(trained, trust=trust)
    assert isinstance(config.task, PlaceRecognitionTask)
    network = trained_place_network(content, found.checkpoint, found.identity, trust=trust)
    predict_places(
        network,
        inputs,
        run_temperature(found),
        config.task.test_tolerance,
        run_facts(given["run"], found, network.model, trained),
    )


def _classify(
    paths: list[Path], content: Mapping[str, Any], checkpoint: Path, trust: bool
) -> tuple[list[dict[str, Any]], list[tuple[np.ndarray, str]]]:
    import torch

    from sextant.runs.checkpoint import KEY
    from sextant.trained.content import own_config
    from sextant.trained.image_spec import image_spec

    spec = image_spec(content[KEY]["spec"])
    if spec.height != spec.width:
        raise UserError(
            f"{checkpoint} takes images of {spec.height}x{spec.width}; only square ones are cropped to fit",
            "Images of a dataset: python evaluate.py run=<...> dataset=<...>",
        )
    raw, config = own_config(content[KEY], trust=trust)
    chances_or_scores = _answering(raw, config, content, checkpoint)
    rows: list[dict[str, Any]] = []
    pictures: list[tuple[np.ndarray, str]] = []
    for batch in _batches(paths):
        images: list[np.ndarray] = []
        entries: list[dict[str, Any]] = []
        for path in batch:
            entry: dict[str, Any] = {"file": str(path)}
            rows.append(entry)
            try:
                images.append(decode_square(path, spec.height, spec.channels))
                entries.append(entry)
            except UserError as error:
                entry["error"] = error.problem
        if not images:
            continue
        stacked = np.stack(images)
        stacked = stacked[:, None] if stacked.ndim == 3 else stacked.transpose(0, 3, 1, 2)
        with torch.no_grad():
            name, found = chances_or_scores(torch.from_numpy(stacked.copy()))
        if bool(found.isnan().any()):
            raise UserError(
                f"the model in {checkpoint} answers with what is no number",
                "Its weights are damaged, or its training diverged. Take another checkpoint.",
            )
        for entry, image, numbers in zip(entries, images, found.tolist(), strict=True):
            best = int(np.argmax(numbers))
            entry |= {"class": spec.classes[best], name: round(numbers[best], 6)}
            # a score of -inf: of this class there was no example
            told = {n: round(p, 6) for n, p in zip(spec.classes, numbers, strict=True) if p > -math.inf}
            entry["probabilities" if name == "probability" else "scores"] = told
            if len(pictures) < SHEET:
                pictures.append((image, f"{spec.classes[best]} {numbers[best]:.2f}"))
    return rows, pictures


def _answering(
    raw: Mapping[str, Any], config: "Config", content: Mapping[str, Any], checkpoint: Path
) -> Callable[["Tensor"], tuple[str, "Tensor"]]:
    """What gives images (bytes) numbers for each class, with the name of such a number."""
    if config.task.name == "cosfire":
        from sextant.recipes.trained_model import model_from_checkpoint

        module = model_from_checkpoint(raw, config, content, checkpoint)
        console.print(f"method {module.methods[0]}")
        return lambda images: ("score", module.predict_step(images))
    from sextant.applications import ImageClassifier  # Lightning would double the time of a short command

    classifier = ImageClassifier.of(content, checkpoint, trust=True)  # whom the config names has been seen to
    return lambda images: ("probability", classifier.probabilities(images))


def _batches(paths: list[Path]) -> Iterator[list[Path]]:
    for start in range(0, len(paths), BATCH):
        yield paths[start : start + BATCH]


def _write(rows: list[dict[str, Any]], output: Path) -> None:
    write_json(output / "predictions.json", rows)
    number = "score" if any("score" in row for row in rows) else "probability"
    write_csv(output / "predictions.csv", ["file", "class", number, "error"], rows)


def _sheet(pictures: list[tuple[np.ndarray, str]], output: Path) -> None:
    from sextant.figures.gallery import gallery
    from sextant.figures.style import save_figure

    if pictures:
        save_figure(gallery([image for image, _ in pictures], [text for _, text in pictures]), output, "predictions")
