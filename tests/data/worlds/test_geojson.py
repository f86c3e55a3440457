"""Towns of GeoJSON files: what is read, what is left out, and what is said of files that are none."""

import json
import logging

import numpy as np
import pytest
from data.worlds.own_towns import building, degrees, feature, street, streets_of, write
from docs_commands import ROOT
from shapely import box
from worlds.graphs import assert_town

from sextant.data.worlds.geojson import load_geojson
from sextant.errors import UserError
from sextant.worlds.street_layouts import grid_streets

CROSSING = (street([(-100, 0), (100, 0)]), street([(0, -100), (0, 100)]))


def test_a_grid_comes_back_with_its_lengths(tmp_path):
    graph = grid_streets(3, 2, 90.0, seed=2, jitter_m=6.0)
    found = load_geojson(write(tmp_path / "grid.geojson", *streets_of(graph)))
    assert np.sort(found.streets.lengths) == pytest.approx(np.sort(graph.lengths), rel=0.01)
    assert found.streets.bounds == pytest.approx((-135, -90, 135, 90), abs=9)
    assert found.footprints is None


@pytest.mark.parametrize("middle", [(-70.0, -53.2), (179.9999, 0.0), (-180.0, 10.0), (15.6, 78.2)])
def test_metres_are_metres_all_over_the_earth(tmp_path, middle):
    line = feature("LineString", degrees([(-600, -800), (0, 0), (600, 800)], middle))
    assert load_geojson(write(tmp_path / "far.geojson", line)).streets.length_m == pytest.approx(2000, rel=0.008)


def test_the_towns_of_the_examples_can_be_built():
    found = load_geojson(ROOT / "examples" / "own_town.geojson")
    assert_town(found.streets)
    assert found.facts["street_kilometres"]["built"] == pytest.approx(
        found.facts["street_kilometres"]["given"], rel=0.02
    )
    assert found.facts["buildings"]["built"] > 0.97 * found.facts["buildings"]["given"] > 200
    assert {"highway=footway": 1, "highway=track": 1, "points": 1}.items() <= found.facts["left_out"].items()


def test_tags_say_what_is_a_street_and_a_building_and_how_large(tmp_path, caplog):
    caplog.set_level(logging.INFO, "sextant")
    found = load_geojson(
        write(
            tmp_path / "osm.geojson",
            street([(-100, 0), (100, 0)], highway="primary"),
            street([(-100, 60), (0, 60), (100, 60)], highway="residential", width="5.5 m", lanes="2"),
            street([(-100, 0), (-100, 60)], highway="tertiary", lanes=3),
            street([(100, 0), (100, 60)], highway="residential", width="broad"),
            street([(0, 0), (0, 60)], other_tags='"highway"=>"residential","width"=>"7"'),
            street([(0, 0), (50, 50)], highway="steps"),
            street([(0, -30), (90, -30)], waterway="stream"),
            building(box(-80, 15, -60, 30), building="yes", **{"building:levels": "3"}),
            building(box(-40, 15, -20, 30), building="house", height=7.5),
            building(box(20, 15, 40, 30), building="yes", height="tall"),
            building(box(60, -5, 80, 10), building="yes"),
            building(box(-80, -60, 80, -20), landuse="grass"),
            building(box(60, 20, 80, 40), building="no"),
            feature("Point", degrees([(0, 0)])[0], highway="crossing"),
            {"type": "Feature", "properties": None, "geometry": None},
        )
    )
    assert sorted(set(found.streets.widths.tolist())) == [5.5, 7, 8, 10.5, 12]
    assert [(each.storeys, each.height_m) for each in found.footprints] == [(3, None), (None, 7.5), (None, None)]
    assert found.facts["streets"] == 5
    assert found.facts["buildings"] == {"given": 4, "built": 3}
    assert found.facts["left_out"] == {
        "highway=steps": 1,
        "lines without highway": 1,
        "areas without building": 1,
        "building=no": 1,
        "points": 1,
        "values of width other than 4 to 20": 1,
        "values of height other than 2 to 300": 1,
        "buildings in a street, in another or far away": 1,
    }
    assert "3 of 4 buildings; left out: " in caplog.text
    assert "highway=steps (1)" in caplog.text


def test_any_root_that_the_standard_allows_is_read(tmp_path):
    lines = {"type": "MultiLineString", "coordinates": [each["geometry"]["coordinates"] for each in CROSSING]}
    houses = {"type": "MultiPolygon", "coordinates": [building(box(20, 20, 40, 40))["geometry"]["coordinates"], []]}
    both = {"type": "GeometryCollection", "geometries": [lines, houses]}
    lengths = set()
    for number, root in enumerate((lines, both, {"type": "Feature", "properties": {}, "geometry": both})):
        path = tmp_path / f"{number}.geojson"
        path.write_text(json.dumps(root), encoding="utf-8-sig")
        found = load_geojson(path)
        lengths.add(round(found.streets.length_m, 6))
        assert (found.footprints is None) == (root is lines)
    assert len(lengths) == 1


def test_a_file_that_changed_is_read_again(tmp_path):
    first = load_geojson(write(tmp_path / "a.geojson", *CROSSING))
    assert load_geojson(tmp_path / "a.geojson") is first
    assert load_geojson(write(tmp_path / "a.geojson", CROSSING[0])).streets.length_m < first.streets.length_m


BAD = {
    "empty": (b"", "is not JSON"),
    "picture": (b"\x89PNG\r\n\x1a\n\xff\xff", "byte 0 is not text in UTF-8"),
    "list": (b"[1, 2]", "is no GeoJSON: feature 1 has no geometry"),
    "overpass": (b'{"version": 0.6, "elements": []}', "is no GeoJSON: feature 1 has no geometry"),
    "nothing": ({"type": "FeatureCollection", "features": []}, "has no street"),
    "features": ({"type": "FeatureCollection"}, "is no GeoJSON: feature 1"),
    "points": ([feature("Point", [12.0, 55.0])], r"has no street; left out: points \(1\)"),
    "buildings": ([building(box(0, 0, 20, 20))], "has no street; it has 1 buildings, and a town needs their streets"),
    "collection": ({"type": "GeometryCollection", "geometries": 5}, "not pairs of numbers"),
    "huge_number": ([feature("LineString", [[10**400, 0], [1, 1]])], "not pairs of numbers"),
    "paths": ([street([(0, 0), (90, 0)], highway="path")], r"has no street; left out: highway=path \(1\)"),
    "projected": ([feature("LineString", [[347000.0, 6173000], [347100, 6173000]])], "not in degrees.*347000, 6.173e"),
    "one_point": ([feature("LineString", [[12.0, 55.0]])], r"feature 1 \(LineString\) has 1 point; at least 2"),
    "open_ring": (
        [*CROSSING, feature("Polygon", [degrees([(20, 20), (40, 20), (40, 40)])])],
        "has 3 points; at least 4",
    ),
    "nan": ([feature("LineString", [[12.0, 55.0], [float("nan"), 55.0]])], "not finite in feature 1"),
    "words": ([feature("LineString", [["a", "b"], ["c", "d"]])], "not pairs of numbers"),
    "flat": ([feature("LineString", [12.0, 55.0, 12.1, 55.0])], "not pairs of numbers"),
    "no_rings": ([*CROSSING, feature("Polygon", [5.0])], "not pairs of numbers"),
    "no_part": ([feature("MultiPolygon", [5.0])], "not pairs of numbers"),
    "text": ([feature("LineString", "12 55")], "no geometry of a known type"),
    "curve": ([feature("CircularString", [[12.0, 55.0], [12.1, 55.0]])], "its type is 'CircularString'"),
    "small": ([street([(0, 0), (40, 0)])], r"1 street over 40\.\d m can be no town: it must be 60 m to 20 km wide"),
    "large": ([street([(0, 0), (40_000, 0)])], "60 m to 20 km wide"),
    "world": ([feature("LineString", [[-80.0, 0], [80.0, 0]])], "spans 160 degrees"),
    "scraps": ([street([(0, 0), (20, 0)]), street([(100, 0), (110, 0)])], "leave no street of 25 m"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_reported_by_name_with_what_to_do(tmp_path, name):
    content, said = BAD[name]
    path = tmp_path / f"{name}.geojson"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(
            json.dumps(content if isinstance(content, dict) else {"type": "FeatureCollection", "features": content})
        )
    with pytest.raises(UserError, match=said) as caught:
        load_geojson(path)
    assert caught.value.problem.startswith(str(path))
    assert caught.value.fix


@pytest.mark.parametrize(
    ("name", "said"), [("missing.geojson", "does not exist"), (".", "cannot be read: Is a directory")]
)
def test_what_is_no_file_is_reported(tmp_path, name, said):
    with pytest.raises(UserError, match=said):
        load_geojson(tmp_path / name)
