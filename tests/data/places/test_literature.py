"""Datasets of the literature: their layouts, in small, are read as their authors place them."""

import numpy as np
import pytest
from data.places.place_pictures import write_pictures

from sextant.chapters.places.data import PlaceTolerance, as_place_source
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.kit.assemble import build_dataset

#: within 25 m
METRES = PlaceTolerance("m", 25.0, 50.0)


def source(name, root):
    small = ("dataset.height=16", "dataset.width=24")
    raw = to_plain(compose(["task=place_recognition", f"dataset={name}", *small]))
    raw["paths"]["data"] = raw["paths"]["cache"] = str(root)
    return as_place_source(build_dataset(validate(raw)))


def utm_name(east, number):
    return f"@{east:.2f}@4477550.00@17@T@40.44@-79.99@pano{number}@@{30 * number}@@@@201109@@.jpg"


def found(places, tolerance):
    reference, *queries = places.conditions
    return [places.positives(places.rows_of(q), places.rows_of(reference), tolerance).toarray() for q in queries]


@pytest.mark.parametrize("name", ["pitts30k", "msls", "st_lucia", "tokyo247", "eynsham"])
def test_names_with_positions(name, tmp_path):
    for part in ("train", "val", "test"):
        folder = tmp_path / name / "images" / part
        write_pictures(folder / "database", [utm_name(584000 + 20 * i, i) for i in range(3)])
        write_pictures(folder / "queries", [utm_name(584010, 7), utm_name(584100, 8)], first=10)
    dataset = source(name, tmp_path)
    (hits,) = found(dataset.read("test"), METRES)
    assert hits.tolist() == [[True, True, False], [False, False, False]]
    if name in ("pitts30k", "msls"):
        assert dataset.read("train").conditions == ("database", "queries")
    if name == "msls":  # the test split has no public truth
        assert all("images/val/" in str(file) for file in dataset.files("test"))


def test_pairs_at_positions_that_were_made_up(tmp_path):
    names = [f"@0@{1000 * k}@@@@@{k}@@@@@@@@.jpg" for k in range(3)]
    for k, folder in enumerate(("database", "queries")):
        write_pictures(tmp_path / "amstertime" / "images" / "test" / folder, names, first=10 * k)
    (hits,) = found(source("amstertime", tmp_path).read("test"), METRES)
    np.testing.assert_array_equal(hits, np.eye(3, dtype=bool))


@pytest.mark.parametrize(
    ("name", "part", "reference", "kinds", "other"),
    [
        ("sf_xl", "processed", "database", ("v1", "v2", "night", "occlusion"), "val"),
        ("svox", "images", "gallery", ("", "night", "overcast", "rain", "snow", "sun"), "train"),
    ],
)
def test_several_folders_of_queries(name, part, reference, kinds, other, tmp_path):
    queries = tuple(f"queries_{kind}".rstrip("_") for kind in kinds)
    folders = [f"test/{folder}" for folder in (reference, *queries)]
    for k, folder in enumerate([*folders, f"{other}/{reference}", f"{other}/queries"]):
        names = [utm_name(584000 + 40 * i, i) for i in range(2)]
        write_pictures(tmp_path / name / part / folder, names, first=10 * k)
    dataset = source(name, tmp_path)
    for hits in found(dataset.read("test"), METRES):
        np.testing.assert_array_equal(hits, np.eye(2, dtype=bool))
    assert dataset.conditions("test") == (reference, *queries)
    assert dataset.read(other).conditions == (reference, "queries")


def test_ranks_are_places(tmp_path):
    for k, folder in enumerate(("ref", "query")):
        write_pictures(tmp_path / "SPEDTEST" / folder, [f"{i:07d}.jpg" for i in range(4)], first=10 * k)
    (hits,) = found(source("sped", tmp_path).read("test"), PlaceTolerance("frames", 0, 1))
    np.testing.assert_array_equal(hits, np.eye(4, dtype=bool))


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "count"), [("gardens_point", 200), ("essex3in1", 210)])
def test_real_walks_and_pairs(name, count, real_data, tmp_path):
    raw_root = tmp_path / "cache"
    raw_root.mkdir()
    (raw_root / name).symlink_to(real_data / name)
    for hits in found(source(name, raw_root).read("test"), PlaceTolerance("frames", 0, 1)):
        np.testing.assert_array_equal(hits, np.eye(count, dtype=bool))
