"""Small pictures of a map: kept beside it, refused when damaged, and not missed by maps of before."""

import shutil

import numpy as np
import pytest

from sextant import Localizer
from sextant.chapters.localization import map_pictures as kept
from sextant.chapters.localization.localizer_folder import PICTURES
from sextant.errors import UserError

RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (6, 120, 160, 3), np.uint8)
POSES = np.column_stack([np.arange(6.0), np.zeros(6), np.array([0, 0, 0, 0, 0, np.pi])])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map") / "saved"
    Localizer.from_images(IMAGES, POSES, "Pixels", steps=2).save(folder)
    return folder


def test_a_map_keeps_small_pictures_of_its_images(folder):
    pictures = Localizer.load(folder).pictures
    assert pictures.shape == (6, 96, 128, 3)
    for image, picture in zip(IMAGES, pictures, strict=True):
        assert abs(float(image.mean()) - float(picture.mean())) < 1  # a mean of neighbours


@pytest.mark.parametrize(
    ("pose", "expected"), [((2.2, 0.1, 0.05), 2), ((4.4, 0.0, 3.0), 5), ((4.4, 0.0, 0.0), 4), ((-9.0, 5.0, 0.0), 0)]
)
def test_the_picture_near_a_pose_is_of_the_nearest_image_that_looks_the_same_way(folder, pose, expected):
    localizer = Localizer.load(folder)
    assert np.array_equal(localizer.picture_near(np.array(pose)), localizer.pictures[expected])


def test_a_map_of_before_has_none_and_is_as_good(folder, tmp_path):
    old = shutil.copytree(folder, tmp_path / "old")
    shutil.rmtree(old / PICTURES)
    localizer = Localizer.load(old)
    assert localizer.pictures is None
    assert localizer.picture_near(np.zeros(3)) is None
    assert np.array_equal(localizer.step(None, IMAGES[2]).pose, Localizer.load(folder).step(None, IMAGES[2]).pose)


@pytest.mark.parametrize("damage", ["altered", "missing", "of another map"])
def test_damaged_pictures_are_refused(folder, tmp_path, damage):
    copied = shutil.copytree(folder, tmp_path / "map")
    file = copied / PICTURES / kept.ARRAY
    if damage == "altered":
        content = bytearray(file.read_bytes())
        content[-5] ^= 1
        file.write_bytes(content)
    elif damage == "missing":
        file.unlink()
    else:
        kept.save_pictures(np.zeros((3, 4, 4, 3), np.uint8), copied / PICTURES)
    with pytest.raises(UserError, match=r"set of pictures in .* is damaged"):
        Localizer.load(copied)


def test_many_images_keep_none_and_old_pictures_go(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(kept, "MOST_BYTES", 6 * 96 * 128 * 3 - 1)
    again = shutil.copytree(folder, tmp_path / "map")
    localizer = Localizer.from_images(IMAGES, POSES, "Pixels", steps=2)
    assert localizer.pictures is None
    localizer.save(again)
    assert Localizer.load(again).pictures is None
    assert not (again / PICTURES / kept.ARRAY).exists()


@pytest.mark.parametrize(
    ("shape", "small"), [((40, 60, 1), (40, 60, 1)), ((192, 3, 1), (96, 2, 1)), ((500, 1, 3), (96, 1, 3))]
)
def test_thumbnails_of_any_shape(shape, small):
    assert kept.thumbnail(np.zeros(shape, np.uint8)).shape == small
