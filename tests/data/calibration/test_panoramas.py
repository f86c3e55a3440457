"""Sources of panoramas: a rendered town, several joined, and what is no source; levels of a panorama."""

import copy
import pickle
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sextant.chapters.calibration.data import (
    PanoramaFolder,
    PanoramaMix,
    Panoramas,
    TownPanoramaSource,
    as_panorama_source,
)
from sextant.chapters.calibration.data.panoramas import Kept, PanoramaSource, top_level
from sextant.data.digits import Digits
from sextant.data.worlds import TownPanoramas, TownSeasons
from sextant.errors import UserError

TOWN = {
    "images": {"train": 5, "val": 1, "test": 2}, "towns": {"train": 2, "val": 1, "test": 1}, "height": 32,
    "samples": 1, "conditions": ["summer_noon"], "size_m": 240.0, "block_m": 80.0, "seed": 3,
}  # fmt: skip


def town(folder, **changes):
    return TownPanoramas(roots=[folder], **(copy.deepcopy(TOWN) | changes))


# -- levels ------------------------------------------------------------------------------------------------------------


def test_a_level_goes_on_around_the_seam_and_over_the_poles():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (16, 32, 3), np.uint8)
    level = Panoramas([image], ["a"]).level(0, 0)
    assert level.shape == (18, 34, 4)
    assert np.array_equal(level[1:-1, 1:-1, :3], image)
    assert np.array_equal(level[1:-1, 0, :3], image[:, -1])
    assert np.array_equal(level[1:-1, -1, :3], image[:, 0])
    assert np.array_equal(level[0, 1:-1, :3], np.roll(image[0], 16, axis=0))
    assert np.array_equal(level[-1, 1:-1, :3], np.roll(image[-1], 16, axis=0))


def test_a_halved_level_is_the_mean_of_four():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (32, 64, 3), np.uint8)
    level = Panoramas([image], ["a"]).level(0, 1)[1:-1, 1:-1, :3]
    mean = image.reshape(16, 2, 32, 2, 3).mean((1, 3))
    assert np.abs(level - mean).max() <= 0.5
    assert [top_level(n) for n in (8, 15, 16, 512, 2048)] == [0, 0, 1, 6, 8]


def test_levels_are_made_once_and_the_oldest_forgotten():
    made = []
    kept = Kept(100)

    def get(key):
        return kept.get(key, lambda: made.append(key) or np.zeros(40, np.uint8))

    for key in "abacab":
        get(key)
    assert made == ["a", "b", "c", "b"]  # b was forgotten for c, a was not


def test_panoramas_go_to_another_process_without_their_levels():
    panoramas = Panoramas([np.zeros((16, 32, 3), np.uint8)], ["a"])
    panoramas.level(0, 0)
    there = pickle.loads(pickle.dumps(panoramas))
    assert there.names == ("a",)
    assert np.array_equal(there.level(0, 0), panoramas.level(0, 0))
    assert len(pickle.dumps(panoramas)) < 2500


# -- the town ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_town_is_rendered_when_it_is_read_and_not_before(tmp_path):
    told = []
    source = TownPanoramaSource(town(tmp_path))
    source.showing = lambda: nullcontext(lambda done, total: told.append((done, total)))
    assert isinstance(source, PanoramaSource)
    assert source.files("train") == []
    print_before = source.fingerprint()
    assert list(tmp_path.iterdir()) == []
    panoramas = source.read("train")
    assert told[0] == (0, 8)
    assert told[-1] == (8, 8)
    assert len(panoramas) == len(panoramas.names) == len(set(panoramas.names)) == 5
    assert panoramas[0].shape == (32, 64, 3)
    assert panoramas[0].std() > 5
    assert source.fingerprint() == print_before
    towns = {split: {name.split("__")[0] for name in source.read(split).names} for split in ("train", "val", "test")}
    assert {name: len(found) for name, found in towns.items()} == {"train": 2, "val": 1, "test": 1}
    assert len(set.union(*towns.values())) == 4


def test_fingerprints_of_other_towns_differ(tmp_path):
    prints = {as_panorama_source(town(tmp_path, seed=seed)).fingerprint() for seed in (1, 2)}
    assert len(prints) == 2


# -- a mix, and what is none -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_mix_joins_splits(tmp_path):
    folder = tmp_path / "own"
    folder.mkdir()
    for i in range(4):
        Image.new("RGB", (128, 64), (60 * i, 0, 0)).save(folder / f"{i}.png")
    own = partial(PanoramaFolder, folder="own", height=64, fractions={"train": 2, "val": 1, "test": 1})
    mix = PanoramaMix({"town": town(tmp_path / "cache"), "own": own}, roots=[tmp_path])
    assert isinstance(mix, PanoramaSource)
    assert mix.name == "town_panoramas+panorama_folder"
    train = mix.read("train")
    assert len(train) == 5 + 2
    assert train[0].shape == (32, 64, 3)
    assert train[5].shape == (64, 128, 3)
    assert len(mix.files("test")) == 1
    assert len(set(train.names)) == 7
    assert mix.fingerprint() != PanoramaMix({"town": town(tmp_path / "cache")}).fingerprint()
    with pytest.raises(UserError, match="empty"):
        PanoramaMix({})


def test_a_source_of_a_mix_can_be_shown_more_often_in_training(tmp_path):
    def own(fill, **sizes):
        folder = tmp_path / fill
        folder.mkdir(exist_ok=True)
        for i in range(4):
            Image.new("RGB", (64, 32), (60 * i, 0, 0)).save(folder / f"{fill}{i}.png")
        return partial(PanoramaFolder, folder=fill, height=32, fractions={"train": 2, "val": 1, "test": 1})

    sources = {"a": own("a"), "b": own("b")}
    once, thrice = PanoramaMix(sources, roots=[tmp_path]), PanoramaMix(sources, {"b": 3}, roots=[tmp_path])
    train = thrice.read("train")
    assert list(train.names) == [*once.read("train").names[:2], *3 * once.read("train").names[2:]]
    assert np.array_equal(train[2], train[4])
    assert np.array_equal(train[3], train[7])
    assert train.level(2, 1) is train.level(6, 1)
    assert len(thrice.read("test")) == len(once.read("test")) == 2
    assert once.fingerprint() != thrice.fingerprint()
    with pytest.raises(UserError, match=r"repeats.c=2: .* a, b"):
        PanoramaMix(sources, {"c": 2}, roots=[tmp_path])


@pytest.mark.parametrize(
    "dataset", [Digits(), TownSeasons(roots=[Path("/nowhere")]), object()], ids=["digits", "town_seasons", "object"]
)
def test_datasets_without_panoramas_are_named(dataset):
    with pytest.raises(UserError, match=f"dataset={getattr(dataset, 'name', 'object')} has no panoramas"):
        as_panorama_source(dataset)
