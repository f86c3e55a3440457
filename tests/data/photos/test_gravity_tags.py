"""Gravity in Apple's maker note, in the frame of the upright picture."""

import math
import struct

import pytest
from data.photos.pictures import save, scene
from PIL import Image

from sextant.data.photos import read_photo
from sextant.data.photos.exif import APPLE, EXIF_BLOCK, LENS_MODEL, MAKER_NOTE

ORIENTATION = 0x0112


def apple_note(*vector, kind=10, count=3, tag=8):
    """A maker note with an accelerometer's vector in g: right, up and out of the screen."""
    entries = struct.pack(">HHII", 1, 9, 1, 7) + struct.pack(">HHII", tag, kind, count, 16 + 2 * 12)
    rationals = b"".join(struct.pack(">ii", round(value * 10_000), 10_000) for value in vector)
    return APPLE + b"\0\0\1MM"[:4] + struct.pack(">H", 2) + entries + rationals


def phone_photo(path, vector, orientation=1, size=(96, 64), lens="iPhone back camera", **changes):
    """A photo as a phone stores it."""
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF_BLOCK)[MAKER_NOTE] = apple_note(*vector, **changes)
    exif.get_ifd(EXIF_BLOCK)[LENS_MODEL] = lens
    return save(path, Image.fromarray(scene()).resize(size), exif=exif)


@pytest.mark.parametrize(
    ("held", "orientation"),
    [((0, -1, 0), 6), ((0, 1, 0), 8), ((-1, 0, 0), 1), ((1, 0, 0), 3)],
    ids=["upright", "on its head", "home button right", "home button left"],
)
def test_however_a_phone_is_held_down_is_down(held, orientation, tmp_path):
    assert read_photo(phone_photo(tmp_path / "a.jpg", held, orientation)).gravity == pytest.approx((0, 1, 0))


def test_a_phone_over_a_table_looks_down_and_one_leaning_back_looks_up(tmp_path):
    assert read_photo(phone_photo(tmp_path / "a.jpg", (0, 0, -1), 6)).gravity == pytest.approx((0, 0, 1))
    up = math.radians(20)  # the screen faces the ground a little
    leaning = (0, -math.cos(up), math.sin(up))
    down = read_photo(phone_photo(tmp_path / "b.jpg", leaning, 6)).gravity
    assert down == pytest.approx((0, math.cos(up), -math.sin(up)), abs=1e-4)


def test_a_phone_turned_clockwise_has_gravity_on_the_right_of_the_picture(tmp_path):
    turned = math.radians(10)  # seen from the front its upper end is right of where it was: the picture leans left
    held = (-math.sin(turned), -math.cos(turned), 0.0)
    assert read_photo(phone_photo(tmp_path / "a.jpg", held, 6)).gravity == pytest.approx(
        (-math.sin(turned), math.cos(turned), 0), abs=1e-4
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"vector": (0, -1.3, 0)},
        {"vector": (0, 0, 0)},
        {"kind": 5},
        {"count": 2},
        {"tag": 9},
        {"lens": "iPhone front camera 2.7mm"},
        {"size": (64, 96)},
    ],
    ids=str,
)
def test_what_cannot_be_relied_on_is_none(changes, tmp_path):
    assert read_photo(phone_photo(tmp_path / "a.jpg", **({"vector": (0, -1, 0)} | changes))).gravity is None


@pytest.mark.parametrize("cut", range(0, 64, 7))
def test_a_note_that_is_cut_is_none(cut, tmp_path):
    exif = Image.Exif()
    exif.get_ifd(EXIF_BLOCK)[MAKER_NOTE] = apple_note(0, -1, 0)[:cut]
    assert read_photo(save(tmp_path / "a.jpg", scene(), exif=exif)).gravity is None
