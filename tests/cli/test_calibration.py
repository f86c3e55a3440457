"""Calibration from the command line: train on a folder, test again from the checkpoint, calibrate photos."""

import json

import numpy as np
import pytest
from calibration_toy import panorama_files, panorama_words
from PIL import Image
from support import evaluated

from sextant.cli import evaluate, predict
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory


def config(folder, outputs, *overrides):
    quick = [
        "task.crops_per_panorama.train=16", "backbone=strided_cnn", "backbone.widths=[8,16,24]",
        "trainer.max_epochs=2", "trainer.workers=0", "trainer.progress=false", "tracking=none",
        f"paths.cache={outputs}/data",
    ]  # fmt: skip
    return to_plain(compose(panorama_words(folder, outputs, *quick, *overrides)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return panorama_files(tmp_path_factory.mktemp("panoramas"))


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    return outputs, RunDirectory(execute(config(folder, outputs)).directory)


def test_a_run_leaves_a_table_figures_and_errors_by_crop(trained):
    _, run = trained
    results = run.results()
    methods = [row["method"] for row in results["table"]]
    assert methods[:7] == [
        "constant", "prior", "vanishing points", "plumb lines", "both", "network", "network + lines",
    ]  # fmt: skip
    assert {path.stem for path in run.figures.iterdir()} >= {"crops", "error_by_parameter", "coverage"}
    with np.load(run.arrays, allow_pickle=False) as arrays:
        assert arrays["tilt_deg/network"].shape == arrays["panoramas"].shape == (6,)


def test_the_same_command_returns_the_finished_run(folder, trained):
    outputs, run = trained
    outcome = execute(config(folder, outputs))
    assert outcome.reused
    assert outcome.directory == run.path


@pytest.mark.slow
def test_evaluation_repeats_the_test_of_training(trained):
    outputs, run = trained
    evaluate.main([f"run={run.path}", "tracking=none", f"paths.outputs={outputs}", f"paths.cache={outputs}/data"])
    (again,) = outputs.glob("runs/evaluation/*/metrics.json")
    found, expected = json.loads(again.read_text())["metrics"], run.results()["metrics"]
    assert found == {key: value for key, value in expected.items() if key.startswith("test/")}


@pytest.mark.slow
def test_an_evaluation_may_leave_out_the_geometric_methods_but_not_change_the_network(trained):
    outputs, run = trained
    words = ("task.geometric_baselines=false", f"paths.cache={outputs}/data")
    tested = evaluated(outputs, run, *words)
    methods = {row["method"] for row in tested.results()["table"]}
    assert "network" in methods
    assert "vanishing points" not in methods
    assert evaluated(outputs, run, *words, "sampling@test_sampling=uniform").path != tested.path
    for wrong in ("task.width=48", "sampling=uniform"):
        with pytest.raises(UserError, match="belongs to the trained weights"):
            evaluated(outputs, run, wrong)


@pytest.mark.slow
def test_photos_of_any_kind_are_calibrated(trained, tmp_path):
    outputs, run = trained
    rng = np.random.default_rng(1)
    photos = tmp_path / "photos"
    photos.mkdir()
    Image.fromarray(rng.integers(0, 255, (90, 160, 3), np.uint8)).save(photos / "wide.jpg")
    Image.fromarray(rng.integers(0, 255, (160, 100), np.uint8)).save(photos / "tall_grey.png")
    (photos / "empty.jpg").touch()
    predict.main([f"run={run.path}", f"input={photos}", f"output={tmp_path / 'out'}", f"outputs={outputs}"])
    said = json.loads((tmp_path / "out" / "wide.json").read_text())
    assert said["focal_px"] > 0
    assert (tmp_path / "out" / "tall_grey.json").is_file()
    assert "empty.jpg" in (tmp_path / "out" / "calibrations.json").read_text()


def test_a_dataset_without_panoramas_is_refused(tmp_path):
    raw = to_plain(compose(["task=calibration", "dataset=digits", f"paths.outputs={tmp_path}"]))
    with pytest.raises(UserError, match="digits has no panoramas"):
        execute(raw)
