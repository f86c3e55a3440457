"""Whatever is given as a photo: no task's prediction crashes, and none answers what it did not see."""

import json
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from cli.cosfire_detection.drawn import drawn
from cli.hostile_images import HostileFile, hostile_files
from cli.photo_calibration.fakes import Fake
from fuzzing import fuzz
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_places import Pixels, scene

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.options import CalibrationOptions
from sextant.chapters.calibration.predict import predict_calibrations
from sextant.chapters.classification import predict as classifying
from sextant.chapters.cosfire.images import read_image
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.places.options import read_inputs
from sextant.chapters.places.place_map import PlaceMap
from sextant.chapters.places.predict import predict_places
from sextant.cli import predict
from sextant.data.image_files import decode_image
from sextant.data.image_folder import decode_square
from sextant.data.photo_files import find_photos
from sextant.data.photos import read_photo
from sextant.data.picture_files import UnreadableImageError
from sextant.errors import UserError
from sextant.kit import handler
from sextant.runs.checkpoint import KEY
from sextant.runs.resolve import FoundRun

Said = dict[str, str | None]


@pytest.fixture(autouse=True, scope="module")
def nothing_is_drawn():
    """Drawing takes longer than all the rest, and every task's drawing has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("figures.style", "chapters.cosfire.predict"):
            patch.setattr(f"sextant.{module}.save_figure", lambda *_: None)
        patch.setattr("sextant.chapters.calibration.figures.overlay.calibration_overlay", lambda _: None)
        patch.setattr("sextant.chapters.calibration.figures.overlay.photo_sheet", lambda _: None)
        for name in ("cosfire_filter", "cosfire_responses"):
            patch.setattr(f"sextant.chapters.cosfire.predict.{name}", lambda *_, **__: None)
        patch.setattr("sextant.chapters.places.predict.write_gallery", lambda *_: [])
        patch.setattr("sextant.chapters.localization.localized_drive.draw_trajectory", lambda *_: None)
        patch.setattr(
            "sextant.chapters.localization.predict.Localizer", SimpleNamespace(load=lambda *_, **__: Nowhere())
        )
        patch.setattr(classifying, "draw", lambda *_: None)
        patch.setattr(handler, "resolve_run", lambda reference, outputs: FoundRun(Path("last.ckpt"), None))
        spec = {"channels": 3, "height": 16, "width": 16, "classes": ["dark", "bright"]}
        content = {KEY: {"task": "classification", "spec": spec}}
        patch.setattr("sextant.kit.trained.read_trained", lambda path: content)
        opened = SimpleNamespace(probabilities=brightness)
        patch.setattr("sextant.chapters.classification.classifier.ImageClassifier.of", lambda *_, **__: opened)
        yield


def brightness(images):
    """A classifier of dark and bright images."""
    bright = images.float().mean((1, 2, 3)) / 255
    return torch.stack([1 - bright, bright], 1)


class Nowhere:
    """A localizer that always is at the origin."""

    descriptor, image_size, unit, odometry_scale = SimpleNamespace(describer=True), (16, 24, 3), "m", 1.0
    recognised = 1.0
    model = SimpleNamespace(map=SimpleNamespace(poses=torch.zeros(2, 3)))

    def step(self, motion, image):
        assert image is None or image.shape == self.image_size
        return LocalizedPose(np.zeros(3), np.eye(3), 1.0, 1, lost=False)


def calibration(photos: Path, output: Path) -> Said:
    paths = find_photos(str(photos), output)
    rows = predict_calibrations(PhotoCalibrator(Fake(), "network"), paths, output, CalibrationOptions(undistort="none"))
    return {Path(row["file"]).name: row.get("error") for row in rows}


def classification(photos: Path, output: Path) -> Said:
    predict.main(["run=x", f"input={photos}", f"output={output}"])
    rows = json.loads((output / "predictions.json").read_text())
    return {Path(row["file"]).name: row.get("error") for row in rows}


def places(photos: Path, output: Path) -> Said:
    there = photos.parent / "map"
    there.mkdir()
    for k in range(3):
        scene(k).save(there / f"{k}.png")
    inputs = read_inputs({"map": str(there), "queries": str(photos), "output": str(output)})
    rows = predict_places(PlaceMap(Pixels()), inputs, {"run": "x"})
    return {row["query"]: row.get("error") for row in rows}


def cosfire(photos: Path, output: Path) -> Said:
    from sextant.chapters.cosfire.options import read_inputs
    from sextant.chapters.cosfire.predict import predict_detections

    example = drawn(photos.parent / "example.png", (90, 80), glyphs=((45, 40),))
    given = {"prototype": str(example), "input": str(photos), "output": str(output)}
    return {Path(row["file"]).name: row.get("error") for row in predict_detections(read_inputs(given))}


def localization(photos: Path, output: Path) -> Said:
    from sextant.chapters.localization.options import LocalizingOptions
    from sextant.chapters.localization.predict import predict_poses

    output.mkdir()
    rows = predict_poses(photos, str(photos), output, LocalizingOptions.of({"replay": "none"}))
    return {row.name: row.problem or None for row in rows}


TASKS = (calibration, classification, places, cosfire, localization)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.__name__)
@settings(fuzz, max_examples=-(-fuzz.max_examples // len(TASKS)))
@given(files=st.lists(hostile_files(), min_size=1, max_size=3, unique_by=lambda file: file.name.lower()))
def test_every_file_is_answered_or_named_with_a_reason(task, files):
    with tempfile.TemporaryDirectory() as name:
        photos, output = Path(name) / "photos", Path(name) / "out"
        photos.mkdir()
        given = {file.write(photos).name: file for file in files if file.content is not None}
        for file in files:
            if file.content is None:
                file.write(photos)
        said, refused = _asked(task, photos, output)
    if refused is not None:
        assert not any(file.is_photo for file in given.values()), refused
        assert all(name in refused.problem for name in given)
        assert refused.fix
        return
    assert set(said) == set(given)
    assert any(problem is None for problem in said.values())
    for name, file in given.items():
        assert said[name] is None or said[name].strip()
        assert not (file.is_photo and said[name]), (file, said[name])
        assert not (file.is_none and said[name] is None), file


READERS = {
    "calibration": lambda path: read_photo(path).image,
    "classification": lambda path: decode_square(path, 16, 3),
    "places and localization": lambda path: decode_image(path, 16, 24, 3),
    "cosfire": lambda path: read_image(path, 64).picture,
}


@pytest.mark.parametrize("reader", READERS)
@settings(fuzz, max_examples=-(-fuzz.max_examples // len(READERS)))
@given(file=hostile_files())
def test_what_is_read_of_a_file_that_was_cut_is_all_of_it(reader, file: HostileFile):
    if file.content is None:
        return
    with tempfile.TemporaryDirectory() as name:
        found = _read(reader, file.write(Path(name)))
        if file.damage not in ("cut", "header", "more", "huge"):
            return
        whole = _read(reader, HostileFile(file.name, file.whole, b"", "none", file.mode, file.size).write(Path(name)))
    if found is not None and file.damage != "huge":
        assert whole is not None
        assert np.array_equal(found, whole), file


def _asked(task, photos, output):
    try:
        return task(photos, output), None
    except UserError as error:
        return {}, error


def _read(reader, path):
    try:
        return READERS[reader](path)
    except (UserError, UnreadableImageError):
        return None
