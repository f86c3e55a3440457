"""Pairs of images, as pycolmap reads them."""

import pycolmap
import pytest
from tiny_places import Pixels, ride

from sextant import PlaceMap
from sextant.chapters.places.written_matches import write_pairs, write_row_pairs
from sextant.errors import ArgumentError


def read(path, names, folder):
    """What COLMAP makes of a file of pairs: names of images."""
    database = pycolmap.Database.open(folder / "names.db")
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=4, height=4, params=[4, 2, 2])
    camera.camera_id = database.write_camera(camera)
    ids = {database.write_image(pycolmap.Image(name=name, camera_id=camera.camera_id)): name for name in names}
    options = pycolmap.ImportedPairingOptions(match_list_path=path)
    pairs = pycolmap.ImportedPairGenerator(options=options, database=database).all_pairs()
    database.close()
    return [(ids[one], ids[other]) for one, other in pairs]


def test_photos_of_a_map_with_those_most_like_them(tmp_path):
    folder = ride(tmp_path / "day", range(5))
    places = PlaceMap(Pixels())
    places.add(folder)
    pairs = places.pairs(2)
    assert len(pairs) == 10
    for k in range(5):
        near = [
            match.photo
            for match in places.look_up(folder / f"{k:03d}.png", 5).matches
            if match.photo.stem != f"{k:03d}"
        ]
        assert [other for one, other in pairs if one == folder / f"{k:03d}.png"] == near[:2]
    assert len(places.pairs(9)) == 20  # of a smaller map all
    assert write_pairs(pairs, tmp_path / "pairs.txt") == folder
    names = sorted(path.name for path in folder.iterdir())
    once = {frozenset((one.name, other.name)) for one, other in pairs}
    found = read(tmp_path / "pairs.txt", names, tmp_path)
    assert len(found) == len(once)
    assert {frozenset(pair) for pair in found} == once


def test_queries_with_their_matches(tmp_path):
    rows = [
        {
            "query": "0.png",
            "matches": [{"match": "7.png"}, {"match": "8.png"}],
            "sequence_matches": [{"match": "8.png"}],
        },
        {"query": "1.png", "error": "is empty"},
    ]
    path = write_row_pairs(rows, tmp_path / "map", tmp_path / "run", tmp_path / "out")
    assert path.read_text() == "run/0.png map/7.png\nrun/0.png map/8.png\n"
    names = ["run/0.png", "map/7.png", "map/8.png"]
    assert read(path, names, tmp_path) == [("run/0.png", "map/7.png"), ("run/0.png", "map/8.png")]


def test_names_that_colmap_cannot_take(tmp_path):
    with pytest.raises(ArgumentError, match=r"'a b\.png' has a space"):
        write_pairs([(tmp_path / "a b.png", tmp_path / "c.png")], tmp_path / "pairs.txt")
    with pytest.raises(ArgumentError, match="does not lie below it"):
        write_pairs([(tmp_path / "a.png", tmp_path / "c.png")], tmp_path / "pairs.txt", tmp_path / "in")
    with pytest.raises(ArgumentError, match="no pair"):
        write_pairs([], tmp_path / "pairs.txt")
