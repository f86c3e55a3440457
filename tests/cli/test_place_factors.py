"""A trained descriptor beside a layer of another network, and against factors of appearance, from end to end."""

import numpy as np
import pytest
import torch
from PIL import Image
from support import as_published, evaluated
from tiny_places import place_words

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.lifecycle.execute import execute
from sextant.models import ResNetCifar
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory

PLACES = {"train": 20, "val": 6, "test": 8}
SHELF = "off the shelf: ResNetCifar layer1"
TOWN = (
    "dataset=town_factors", "dataset.frames={train: 12, val: 4, test: 8}", "dataset.places={train: 5, test: 6}",
    "dataset.height=16", "dataset.width=24", "dataset.samples=1", "dataset.block_m=70.0",
    "dataset.factors.fog_per_m=[0.05, 0.3]", "dataset.factors.exposure_ev=[-6]",
    "dataset.only=[fog_per_m, exposure_ev]",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Places as noise, by day and in two densities of fog, which take contrast."""
    root = tmp_path_factory.mktemp("places")
    rng = np.random.default_rng(0)
    for split, count in PLACES.items():
        for k in range(count):
            picture = rng.integers(0, 256, (16, 24, 3)).astype(float)
            for light, contrast in (("day", 1.0), ("half", 0.5), ("dense", 0.1)):
                path = root / split / light / f"{k:03d}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                noisy = 128 + contrast * (picture - 128) + rng.normal(scale=20, size=picture.shape)
                Image.fromarray(noisy.clip(0, 255).astype(np.uint8)).save(path)
    return root


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    torch.manual_seed(0)
    network = ResNetCifar(3, (32, 32), 10, depth=8)
    return as_published(network, tmp_path_factory.mktemp("published") / "checkpoint.pth.tar")


def config(folder, outputs, *overrides):
    chosen = ("pooling.grid=null", "task.batch_places=12", "task.whitening=null", "trainer.max_epochs=1", *overrides)
    return to_plain(compose(place_words(folder, outputs, *chosen, conditions=("day", "half"))))


@pytest.fixture(scope="module")
def trained(folder, shelf, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    chosen = f"task.off_the_shelf={{weights: {shelf}, layer: layer1, dimension: 8}}"
    return outputs, RunDirectory(execute(config(folder, outputs, chosen)).directory)


@pytest.mark.slow
def test_the_layer_is_a_row_of_the_table(trained):
    _, run = trained
    rows = {row["method"]: row for row in run.results()["table"]}
    assert rows[SHELF]["dim"] == "8"  # whitened, from the training images of the map
    assert list(rows)[-1] == "network"
    with np.load(run.arrays, allow_pickle=False) as arrays:
        assert f"R@1_pm0f_half_to_day/{SHELF}" in arrays
        assert arrays["R@1_pm0f/pairs/recall"].shape == (2, 2)
    results = run.results()
    assert results["metrics"]["test/R_at_1_pm0f_day_to_half"] >= 0
    assert results["ceiling"] == {"R@1_pm0f_half_to_day": 1.0}


@pytest.mark.slow
def test_a_whitening_that_cannot_be_learnt_is_named(trained, shelf):
    outputs, run = trained
    wish = f"task.off_the_shelf={{weights: {shelf}, layer: layer1, dimension: 100}}"
    results = evaluated(outputs, run, wish).results()
    assert SHELF not in {row["method"] for row in results["table"]}
    assert "needs more reference images" in results["baselines_left_out"]["half"][SHELF]


@pytest.mark.slow
def test_conditions_named_by_factors_become_curves(trained):
    outputs, run = trained
    tested = evaluated(outputs, run, r"dataset.test={day: test/day, fog\=0.5: test/half, fog\=0.9: test/dense}")
    assert {path.stem for path in tested.figures.glob("*.png")} == {"invariance_curves"}
    results = tested.results()
    curves = results["invariance"]["factors"]["fog"]
    assert {"pixels", "HOG", "untrained network", "network", SHELF} <= set(curves)
    assert curves["pixels"]["values"] == [0.5, 0.9]
    assert curves["pixels"]["recall"][0] == 1
    metrics = results["metrics"]
    for value, recall in zip((0.5, 0.9), curves["network"]["recall"], strict=True):
        assert metrics[f"test/R_at_1_pm0f_fog_{value}_to_day"] == recall
    assert metrics["test/recall_at_1"] == pytest.approx(np.mean(curves["network"]["recall"]))


@pytest.mark.slow
def test_curves_need_no_validation_split(trained):
    outputs, run = trained
    test = r"dataset.test={day: test/day, fog\=+0.5: test/half}"
    words = (test, "dataset.val=null", "dataset.train=null", "task.baselines=false")
    results = evaluated(outputs, run, *words).results()
    assert set(results["invariance"]["factors"]["fog"]) == {"network"}
    assert "test/R_at_1_pm0f_fog__0.5_to_day" in results["metrics"]  # MLflow takes no +


@pytest.mark.slow
def test_the_town_is_rendered_and_curves_are_drawn(trained):
    outputs, run = trained
    tested = evaluated(outputs, run, *TOWN, f"paths.cache={outputs / 'cache'}")
    assert (tested.figures / "invariance_curves.png").is_file()
    results = tested.results()
    found = results["invariance"]
    assert found["value_in_map"] == {"fog_per_m": 0.0, "exposure_ev": 0.0}
    assert found["factors"]["fog_per_m"]["HOG"]["values"] == [0, 0.05, 0.3]
    assert found["factors"]["exposure_ev"]["HOG"]["values"] == [-6, 0]
    ours, again = found["factors"]["fog_per_m"]["HOG"]["recall"], found["factors"]["exposure_ev"]["HOG"]["recall"][-1]
    assert ours[0] == again
    assert set(results["baselines_left_out"]) == {"off the shelf: ResNetCifar layer1"}


def test_nothing_is_trained_on_it(tmp_path):
    chosen = ["task=place_recognition", *TOWN, f"paths.outputs={tmp_path}", "tracking=none"]
    raw = to_plain(compose(chosen))
    family, parsed = chapter_of("place_recognition"), validate(raw)
    with pytest.raises(UserError, match=r"is for tests.*\n.*sextant evaluate run=<run> dataset=town_factors"):
        family.check(family.source(parsed))


def test_weights_that_are_missing_are_told_before_training(folder, tmp_path):
    with pytest.raises(UserError, match=r"off_the_shelf\.weights=gone\.pth does not exist"):
        execute(config(folder, tmp_path, "task.off_the_shelf={weights: gone.pth, network: alexnet}"))
    assert not any(tmp_path.glob("runs/*/*"))
