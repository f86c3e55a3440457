"""Rides and folders of place recognition as drives."""

import numpy as np
import pytest
from data.places.place_pictures import picture, write_pictures

from sextant.chapters.localization.data import DriveSettings, LocalizationSource, as_localization_source
from sextant.chapters.localization.data.drive import motions_along
from sextant.chapters.places.data import Nordland, PlaceFolders
from sextant.errors import UserError

NAMES = [f"images-{10 * k:05d}.png" for k in range(1, 13)]
RIDE = {"frames": {"train": (0, 4), "val": (5, 7), "test": (7, None)}, "height": 16, "width": 24}


@pytest.fixture
def railway(tmp_path):
    for k, season in enumerate(("summer", "winter", "fall")):
        write_pictures(tmp_path / "nordland" / season, NAMES, first=100 * k)
    return tmp_path


def test_a_railway_is_a_line_of_frames(railway):
    dataset = Nordland(("summer", "winter", "fall"), roots=[railway], **RIDE)
    source = as_localization_source(dataset)
    assert isinstance(source, LocalizationSource)
    assert source.conditions() == ("summer", "winter", "fall")
    assert len(source.files("test")) == 3 * 5
    assert len(source.files("validation")) == 3 * (4 + 2)
    data = source.read()
    assert (data.unit, data.protocol) == ("frames", "railway")
    assert [drive.name for drive in data.test] == ["test/winter", "test/fall"] == [d.name for d in data.other_maps]
    assert [drive.name for drive in data.validation] == ["val/winter", "val/fall"]
    assert data.map.poses[:, 0].tolist() == [7, 8, 9, 10, 11]
    assert data.validation_map.poses[:, 0].tolist() == [0, 1, 2, 3, 5, 6]
    assert np.array_equal(data.validation_map.images[4], picture(5))
    assert np.array_equal(data.test[0].images[2], picture(109))
    assert np.array_equal(data.validation[1].images[1], picture(206))
    for drive in (data.map, *data.test, *data.validation):
        assert (drive.poses[:, 1:] == 0).all()
        assert (drive.motion[:, 1:] == 0).all()
    assert not np.array_equal(data.test[0].motion, data.test[1].motion)
    exact = as_localization_source(dataset, DriveSettings(odometry_scale=0.0))
    assert np.array_equal(exact.read().test[0].motion, motions_along(data.test[0].poses))
    assert exact.fingerprint() != source.fingerprint() == as_localization_source(dataset).fingerprint()


def test_a_missing_frame_is_a_longer_step(railway):
    (railway / "nordland" / "winter" / NAMES[9]).unlink()
    dataset = Nordland(roots=[railway], skip_bad=True, **RIDE)
    data = as_localization_source(dataset, DriveSettings(odometry_scale=0.0)).read()
    assert data.test[0].motion[:, 0].tolist() == [0, 1, 2, 1]
    assert "winter/images-00100 is missing" in data.notes


def test_one_season_cannot_be_localized(railway):
    with pytest.raises(UserError, match="leaves none to localize"):
        as_localization_source(Nordland(("summer",), roots=[railway], **RIDE)).read()


@pytest.mark.real_data
def test_the_real_railway(real_data, tmp_path):
    ranges = {"train": (0, 30), "val": (30, 40), "test": (40, 60)}
    data = as_localization_source(Nordland(frames=ranges, roots=[real_data, tmp_path])).read()
    assert data.map.images.shape == (20, 32, 64, 3)
    assert len(data.validation_map) == 40
    assert data.test[0].condition == "winter"
    summer, winter = data.map.images[:].astype(float), data.test[0].images[:].astype(float)
    assert summer.std() > 20
    assert winter.std() > 20
    assert not np.array_equal(summer, winter)
    assert data.test[0].motion[1:, 0].std() == pytest.approx(0.1, rel=0.5)


# -- the user's folders ------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    for k, traverse in enumerate(("reference", "query")):
        names = [f"{i}.png" for i in range(8)]
        write_pictures(tmp_path / traverse, names, first=10 * k)
        rows = [f"{name},{3 * i + k / 10},{k / 5},{90 if k else 370}" for i, name in enumerate(names)]
        (tmp_path / traverse / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))
    return tmp_path


def folders(folder, **changes):
    return PlaceFolders(str(folder), height=16, width=24, **changes)


def test_folders_with_headings_are_drives(folder):
    data = as_localization_source(folders(folder)).read()
    assert (data.map.name, data.validation[0].name, data.test[0].name) == (
        "test/reference", "test/query/start", "test/query"
    )  # fmt: skip
    assert (len(data.map), len(data.validation[0]), len(data.test[0])) == (8, 2, 6)
    assert np.allclose(data.map.poses[:, 2], np.radians(10))
    assert np.allclose(data.test[0].poses[0], [6.1, 0.2, np.pi / 2])
    assert np.array_equal(data.test[0].images[0], picture(12))
    halves = as_localization_source(folders(folder), DriveSettings(validation_share=0.5)).read()
    assert (len(halves.validation[0]), len(halves.test[0])) == (4, 4)


def test_folders_of_their_own_for_validation(folder):
    splits = {"test": {"a": "reference", "b": "query"}, "val": {"c": "old", "d": "older"}}
    for k, name in enumerate(("old", "older")):
        write_pictures(folder / name, ["0.png", "1.png"], first=50 + 10 * k)
        (folder / name / "poses.csv").write_text("file,x,y,heading\n0.png,0,0,0\n1.png,1,0,0")
    data = as_localization_source(folders(folder, **splits)).read()
    assert (data.validation_map.name, data.validation[0].name) == ("val/c", "val/d")
    assert len(data.test[0]) == 8


def test_headings_of_utm_names_are_compass_bearings(tmp_path):
    for traverse in ("reference", "query"):
        names = [f"@{500000 + i}@4000000@30@S@@@@@{bearing}@@@@@@.png" for i, bearing in enumerate((0, 90, 180, 270))]
        write_pictures(tmp_path / traverse, names, first=5 if traverse == "query" else 0)
    data = as_localization_source(folders(tmp_path, places="utm")).read()
    north_east_south_west = [np.pi / 2, 0, -np.pi / 2, -np.pi]
    assert np.allclose(np.exp(1j * data.map.poses[:, 2]), np.exp(1j * np.array(north_east_south_west)))


def test_what_is_missing_of_a_pose_is_told(folder):
    with pytest.raises(UserError, match=r"needs x, y and heading(.|\n)*pose_folder"):
        as_localization_source(folders(folder, places="order"))
    (folder / "query" / "poses.csv").write_text("file,x,y\n" + "\n".join(f"{i}.png,{i},0" for i in range(8)))
    with pytest.raises(UserError, match=r"8 of 8 images of query have no heading, query/0.png"):
        as_localization_source(folders(folder)).read()
