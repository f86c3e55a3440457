"""The network of places that comes with the package: it serves wherever a run is taken, and its card is right."""

import csv

import numpy as np
import pytest
from PIL import Image

from benchmarks.place_sets import hits, image_sets
from sextant import Localizer, PlaceMap, cli
from sextant.chapters.places.match_confidence import UNSEEN
from sextant.chapters.places.saved_map import FITTED
from sextant.zoo import model_file, read_card

REFERENCE = "zoo:places"
#: points by which recall may move: one query of the smallest set
POINTS = 0.5


def street(k, night):
    """Blocks of colours; at night darker and noisy."""
    rng = np.random.default_rng(k)
    picture = np.asarray(Image.fromarray(rng.integers(0, 255, (4, 6, 3), np.uint8)).resize((192, 128), 2), float)
    if night:
        picture = 0.5 * picture + np.random.default_rng(k + 99).normal(scale=10, size=picture.shape)
    return Image.fromarray(picture.clip(0, 255).astype(np.uint8))


@pytest.fixture(scope="module")
def rides(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rides")
    for name, night in (("day", False), ("night", True)):
        (folder / name).mkdir()
        for k in range(6):
            street(k, night).save(folder / name / f"{k}.png")
    return folder


def test_a_map_finds_photos_with_it_and_is_saved_with_its_confidences(rides, tmp_path):
    places = PlaceMap.load(REFERENCE)
    places.add(rides / "day")
    places.save(tmp_path / "map")
    for each in (places, PlaceMap.open(tmp_path / "map")):
        found = [each.look_up(rides / f"night/{k}.png") for k in range(6)]
        assert [f.best.photo.name for f in found] == [f"{k}.png" for k in range(6)]
        fitted = read_card(model_file(REFERENCE))["model"]["spec"][FITTED]
        expected = 1 / (1 + np.exp(-(fitted["slope"] * found[0].margin + fitted["offset"])))
        assert found[0].found == pytest.approx(expected)
        assert found[0].found != pytest.approx(float(UNSEEN.probability(np.array([found[0].margin]))[0]))
        assert 0 < found[0].best.confidence <= 1


@pytest.mark.parametrize("reference", [REFERENCE, "zoo:streets"])
def test_a_command_takes_it_for_a_run(reference, rides, tmp_path):
    cli.run("predict", [f"run={reference}", f"map={rides / 'day'}", f"queries={rides / 'night'}", f"output={tmp_path}"])
    rows = [row for row in csv.DictReader((tmp_path / "matches.csv").open()) if row["rank"] == "1"]
    assert [row["match"] for row in rows] == [row["query"] for row in rows]
    assert all(row["confidence"] for row in rows)


@pytest.mark.slow
@pytest.mark.real_data
def test_its_card_tells_what_it_scores(real_data):
    scores = {row["set"]: row for row in read_card(model_file(REFERENCE))["metrics"]["sets"]}
    places = PlaceMap.load(REFERENCE)
    for each in image_sets(real_data):
        found = each.described(places.descriptor.describer.describe, places.size.height, places.size.width)
        for key, centring in (("R@1", "none"), ("R@1 less the running mean", "running")):
            recall = 100 * hits(found.similarities(centring), found.positives).mean()
            assert recall == pytest.approx(scores[each.name][key], abs=POINTS)


def test_a_localizer_describes_its_images_with_it(rides):
    images = [np.array(Image.open(rides / f"day/{k}.png")) for k in range(6)]
    poses = [(1.0 * k, 0.0, 0.0) for k in range(6)]
    here = Localizer.from_images(images, poses, REFERENCE, steps=2, particles=50)
    places = PlaceMap.load(REFERENCE)
    expected = places.descriptor.describer.describe(images[2][None])[0]
    np.testing.assert_allclose(here.describe(images[2]), expected, rtol=1e-5, atol=1e-6)
    here.step(None, rides / "day/2.png")  # a file is decoded into an array that cannot be written to
