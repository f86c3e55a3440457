"""Positions of GPS in metres: as COLMAP places them; and headings."""

import numpy as np
import pycolmap
import pytest
from data.places.gps_pictures import add_gps, wgs84
from data.places.place_pictures import write_pictures

from sextant.chapters.places.data.gps_poses import course_deg, drive_by_gps, gps_poses, local_poses
from sextant.data.photos.gps import GpsPosition, photo_gps
from sextant.errors import ArgumentError


@pytest.mark.parametrize("place", [(55.7, 13.2), (-33.5, 151.0), (0.01, 179.999), (80.0, -70.0), (-89.0, 5.0)])
def test_metres_and_headings_are_those_of_colmap(place):
    rng = np.random.default_rng(0)
    given = np.column_stack([place + rng.normal(scale=0.003, size=(40, 2)), rng.normal(scale=50, size=40)])
    directions = rng.uniform(0, 360, 40)
    found = np.array(local_poses([GpsPosition(*row, way) for row, way in zip(given.tolist(), directions, strict=True)]))
    theirs = wgs84().ellipsoid_to_enu(given, *given[0])
    np.testing.assert_allclose(found[:, :2], theirs[:, :2], rtol=0, atol=1e-6)
    angle = np.radians(directions)
    steps = np.column_stack([np.sin(angle), np.cos(angle), np.zeros(40)])
    ahead = np.concatenate(
        [wgs84().enu_to_ellipsoid(step[None], *row) for step, row in zip(steps, given.tolist(), strict=True)]
    )
    way = (wgs84().ellipsoid_to_enu(ahead, *given[0]) - theirs)[:, :2]
    along = np.column_stack([np.cos(np.radians(found[:, 2])), np.sin(np.radians(found[:, 2]))])
    np.testing.assert_allclose(way / np.linalg.norm(way, axis=1, keepdims=True), along, rtol=0, atol=1e-6)


def test_what_is_lacking_is_lacking_here():
    first, second = local_poses([GpsPosition(57.0, 9.9, None, 0.0), GpsPosition(57.0, 9.9, None)])
    assert (first.x, first.y, first.heading_deg) == (0, 0, pytest.approx(90))
    assert second.heading_deg is None


def test_photos_without_a_position_are_named(tmp_path):
    write_pictures(tmp_path, ["a.png", "b.png"])
    add_gps(tmp_path / "a.png", 3, 4, 30)
    assert photo_gps(tmp_path / "a.png").position.direction_deg == pytest.approx(60)
    assert photo_gps(tmp_path / "gone.png").position is None
    with pytest.raises(ArgumentError, match=r"map: 1 of 2 images has no GPS position in EXIF\n.*b\.png"):
        gps_poses([tmp_path / "a.png", tmp_path / "b.png"], "map")


def test_the_image_at_the_origin_is_not_counted_twice(tmp_path):
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    write_pictures(tmp_path, [path.name for path in paths])
    with pytest.raises(ArgumentError, match="map: 2 of 2 images have no GPS position"):
        drive_by_gps(paths, paths[0], "map", [])


def test_the_way_along_a_circle_with_a_stop_in_noise():
    angle = np.concatenate([np.linspace(0, 2, 50), np.full(20, 2.0), np.linspace(2, 4, 50)])
    noise = np.random.default_rng(0).normal(scale=0.05, size=(120, 2))
    found = course_deg(40 * np.column_stack([np.cos(angle), np.sin(angle)]) + noise)
    assert np.abs(found - np.degrees(angle) - 90).max() < 5
    assert course_deg(noise) is None


def test_the_reader_of_colmap_finds_the_same(tmp_path):
    (tmp_path / "in").mkdir()
    write_pictures(tmp_path / "in", ["a.jpg"])
    add_gps(tmp_path / "in" / "a.jpg", 300, -200)
    pycolmap.Database.open(tmp_path / "a.db").close()
    pycolmap.import_images(tmp_path / "a.db", tmp_path / "in")
    database = pycolmap.Database.open(tmp_path / "a.db")
    (prior,) = database.read_all_pose_priors()
    database.close()
    found = photo_gps(tmp_path / "in" / "a.jpg").position[:3]
    np.testing.assert_allclose(found, prior.position, rtol=0, atol=1e-5)  # the altitude has 32 bits there
