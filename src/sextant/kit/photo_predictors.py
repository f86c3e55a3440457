"""Predictions of trained models for photos as table rows, for callers over a network."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sextant.errors import UserError
from sextant.kit.content import own_config, read_trained
from sextant.runs.checkpoint import KEY

Kind = Literal["string", "double", "doubles"]
Row = dict[str, Any]
#: column of every table: why a photo has no answer; empty if it has one
ERROR = "error"


@dataclass(frozen=True)
class PhotoPredictor:
    """A trained model that predicts from single photos.

    Attributes:
        columns: columns of the prediction and their types: strings, numbers or lists of numbers.
        answer: returns rows for photos of any kind and size, in order; columns without an answer are left out.
    """

    columns: Mapping[str, Kind]
    answer: Callable[[Sequence[Path]], list[Row]]

    def predict(self, photos: Sequence[Path]) -> list[Row]:
        """A row with all columns for each photo, None where there is no answer, and the column ``error``."""
        missing: Row = dict.fromkeys(self.columns)
        return [{**missing, ERROR: "", **row} for row in self.answer(photos)]


def photo_predictor(checkpoint: Path, *, trust: bool = False) -> PhotoPredictor:
    """The photo predictor of a checkpoint.

    Args:
        checkpoint: checkpoint of a run.
        trust: allow parts from outside Sextant that it names.

    Raises:
        UserError: the file is damaged, or its model does not predict from single photos.
    """
    content = read_trained(checkpoint)
    task = str(content[KEY]["task"])
    if task not in PREDICTORS:
        raise UserError(
            f"a model of task={task} does not answer photos one by one",
            f"Register a run of {', '.join(PREDICTORS)}; sextant.Localizer follows a robot.",
        )
    return PREDICTORS[task](content, checkpoint, trust)


def _classifier(content: Mapping[str, Any], checkpoint: Path, trust: bool) -> PhotoPredictor:
    from sextant.applications import FailedPhoto, ImageClassifier

    classifier = ImageClassifier.of(content, checkpoint, trust=trust)

    def answer(photos: Sequence[Path]) -> list[Row]:
        found = classifier.classify_many(photos, errors="return")
        return [
            _failed(each.error) if isinstance(each, FailedPhoto) else {"label": each.label, "score": each.probability}
            for each in found
        ]

    return PhotoPredictor({"label": "string", "score": "double"}, answer)


def _filters(content: Mapping[str, Any], checkpoint: Path, trust: bool) -> PhotoPredictor:
    import torch

    from sextant.data.image_folder import decode_square
    from sextant.kit.trained_model import model_from_checkpoint

    estimator = model_from_checkpoint(own_config(content[KEY], trust=trust), content, checkpoint).estimator
    spec = content[KEY]["spec"]

    def one(photo: Path) -> Row:
        try:
            pixels = torch.from_numpy(decode_square(photo, spec["height"], spec["channels"]).copy())
        except UserError as error:
            return _failed(error)
        (scores,) = estimator.first_scores(pixels.reshape(spec["height"], spec["width"], -1).permute(2, 0, 1)[None])
        best = int(scores.argmax())
        return {"label": spec["classes"][best], "score": float(scores[best])}

    return PhotoPredictor({"label": "string", "score": "double"}, lambda photos: [one(photo) for photo in photos])


def _camera(content: Mapping[str, Any], checkpoint: Path, trust: bool) -> PhotoPredictor:
    from sextant.applications import FailedPhoto, PhotoCalibrator

    calibrator = PhotoCalibrator.of(content, checkpoint, trust=trust)
    numbers = ("tilt_deg", "roll_deg", "focal_px", "vfov_deg", "k1")

    def answer(photos: Sequence[Path]) -> list[Row]:
        rows = []
        for camera in calibrator.calibrate_many(photos, errors="return"):
            if isinstance(camera, FailedPhoto):
                rows.append(_failed(camera.error))
                continue
            row = {name: getattr(camera, name) for name in numbers}
            for name in numbers:
                row[f"{name}_low_95"], row[f"{name}_high_95"] = getattr(camera.interval_95, name)
            rows.append(row | {"verdict": camera.verdict})
        return rows

    ends = [f"{name}_{end}_95" for name in numbers for end in ("low", "high")]
    columns: dict[str, Kind] = {"verdict": "string", **dict.fromkeys([*numbers, *ends], "double")}
    return PhotoPredictor(columns, answer)


def _descriptor(content: Mapping[str, Any], checkpoint: Path, trust: bool) -> PhotoPredictor:
    from sextant.chapters.places.describing import describe
    from sextant.chapters.places.place_network import trained_place_network

    network = trained_place_network(content, checkpoint, str(checkpoint), trust=trust)

    def answer(photos: Sequence[Path]) -> list[Row]:
        found = describe(network, network.size, photos)
        rows = iter(found.rows.tolist())
        return [
            {ERROR: found.failed[number]} if number in found.failed else {"descriptor": next(rows)}
            for number in range(len(photos))
        ]

    return PhotoPredictor({"descriptor": "doubles"}, answer)


def _failed(error: UserError) -> Row:
    return {ERROR: error.problem}


#: by task whose models predict from single photos: the function that makes the predictor
PREDICTORS: Mapping[str, Callable[[Mapping[str, Any], Path, bool], PhotoPredictor]] = {
    "calibration": _camera,
    "classification": _classifier,
    "place_recognition": _descriptor,
    "cosfire": _filters,
}
