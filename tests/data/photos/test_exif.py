import math

import pytest
from data.photos.pictures import exif_with, save, scene
from data.photos.tags import (
    ASCII,
    BYTE,
    DOUBLE,
    FLOAT,
    LONG,
    RATIONAL,
    SBYTE,
    SHORT,
    SLONG,
    SRATIONAL,
    SSHORT,
    UNDEFINED,
    exif_bytes,
    with_tags,
)
from PIL import Image

from sextant.data.photos import exif as exif_tags
from sextant.data.photos import exif_focal_px, read_photo
from sextant.data.photos.header import read_header


def test_the_35mm_equivalent_compares_diagonals(tmp_path):
    photo = read_photo(save(tmp_path / "p.jpg", scene(), exif=exif_with(FOCAL_35MM=50)))
    assert photo.exif_focal_px == pytest.approx(50 * math.hypot(96, 64) / math.hypot(36, 24))
    assert photo.exif_focal_px == pytest.approx(50 / 36 * 96)  # a photo of 3:2, as the film


@pytest.mark.parametrize(("unit", "per_mm"), [(2, 25.4), (3, 10.0), (4, 1.0)])
def test_the_resolution_of_the_focal_plane_in_any_unit(unit, per_mm):
    exif = {
        exif_tags.FOCAL_LENGTH: 6.0,
        exif_tags.PLANE_X_RESOLUTION: 500.0 * per_mm,
        exif_tags.PLANE_UNIT: unit,
        exif_tags.PIXELS_X: 4000.0,
        exif_tags.PIXELS_Y: 3000.0,
    }
    assert exif_focal_px(exif, 4000, 3000) == pytest.approx(3000)
    assert exif_focal_px(exif, 2000, 1500) == pytest.approx(1500)  # scaled since
    assert exif_focal_px(exif, 3000, 4000) == pytest.approx(3000)  # turned since
    assert exif_focal_px(exif, 3000, 3000) is None  # cropped since
    assert [exif_tags.was_cropped(exif, *size) for size in ((4000, 3000), (3000, 4000), (3000, 3000))] == [
        False,
        False,
        True,
    ]


@pytest.mark.parametrize("value", [0, 1e-9, 1e9])
def test_a_focal_length_that_no_lens_has_is_none(tmp_path, value):
    exif = {exif_tags.FOCAL_35MM: float(value)}
    assert exif_focal_px(exif, 4000, 3000) is None


def test_photos_of_a_castle_tell_their_focal_length(real_data):
    for path in sorted((real_data / "photos" / "sceaux_castle").glob("*.JPG")):
        assert read_photo(path).exif_focal_px == pytest.approx(2905.88, rel=0.02)  # K.txt


def test_broken_metadata_is_no_reason_to_refuse_a_photo(tmp_path):
    path = save(tmp_path / "p.jpg", scene(), exif=exif_with(6, FOCAL_35MM=28))
    content = bytearray(path.read_bytes())
    start = content.index(b"Exif\0\0") + 6
    content[start + 4 : start + 8] = b"\xff\xff\xff\x7f"  # the offset of its first directory
    path.write_bytes(content)
    photo = read_photo(path)
    assert photo.orientation == 1
    assert photo.exif_focal_px is None


# -- each tag on its own: its type, count, denominator and size --------------------------------------------------------

F35 = exif_tags.FOCAL_35MM
IN_PIXELS = 28 * math.hypot(96, 64) / math.hypot(36, 24)
ODD = {
    "focal length as text": {exif_tags.FOCAL_LENGTH: (ASCII, b"4.2 mm\0")},
    "focal length as words": {exif_tags.FOCAL_LENGTH: (ASCII, b"unknown\0")},
    "focal length of 0/0": {exif_tags.FOCAL_LENGTH: (RATIONAL, [0, 0])},
    "infinite focal length": {exif_tags.FOCAL_LENGTH: (RATIONAL, [42, 0])},
    "negative focal length": {exif_tags.FOCAL_LENGTH: (SRATIONAL, [-42, 10])},
    "nan": {exif_tags.FOCAL_LENGTH: (DOUBLE, [math.nan])},
    "several focal lengths": {exif_tags.FOCAL_LENGTH: (RATIONAL, [42, 10, 84, 10])},
    "resolution of 0/0": {exif_tags.PLANE_X_RESOLUTION: (RATIONAL, [0, 0])},
    "resolution as text": {exif_tags.PLANE_X_RESOLUTION: (ASCII, b"high\0")},
    "huge resolution": {exif_tags.PLANE_X_RESOLUTION: (FLOAT, [3e38])},
    "unit as text": {exif_tags.PLANE_UNIT: (ASCII, b"inch\0")},
    "unknown unit": {exif_tags.PLANE_UNIT: (SHORT, [77])},
    "only the width": {exif_tags.PIXELS_X: (LONG, [4000])},
    "only the height": {exif_tags.PIXELS_Y: (LONG, [4000])},
    "width as text": {exif_tags.PIXELS_X: (ASCII, b"wide\0"), exif_tags.PIXELS_Y: (LONG, [64])},
    "sides of zero": {exif_tags.PIXELS_X: (LONG, [0]), exif_tags.PIXELS_Y: (LONG, [0])},
    "huge width": {exif_tags.PIXELS_X: (LONG, [2**32 - 1]), exif_tags.PIXELS_Y: (LONG, [64])},
    "time as a number": {0x9003: (LONG, [7]), 0x9291: (SHORT, [50])},
    "time as bytes": {0x9003: (UNDEFINED, b"\xff" * 20)},
    "maker note as text": {0x927C: (ASCII, b"Apple iOS\0")},
    "short maker note": {0x927C: (UNDEFINED, b"Apple iOS\0\0\1MM\xff\xff")},
    "unknown type": {0x9999: (99, b"x")},
    "lens model as bytes": {0xA434: (UNDEFINED, b"\xff\xfe")},
}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", ODD)
def test_one_odd_tag_costs_only_itself(tmp_path, name, order):
    path = with_tags(tmp_path / "p.jpg", exif={F35: (SHORT, [28])} | ODD[name], order=order)
    photo, header = read_photo(path), read_header(path)
    assert photo.exif_focal_px == header.focal_px == pytest.approx(IN_PIXELS)
    assert not photo.cropped


@pytest.mark.parametrize(
    "value",
    [(SHORT, [28]), (LONG, [28]), (BYTE, b"\x1c"), (UNDEFINED, b"\x1c"), (SBYTE, b"\x1c"), (SSHORT, [28]),
     (SLONG, [28]), (RATIONAL, [28, 1]), (SRATIONAL, [280, 10]), (FLOAT, [28.0]), (DOUBLE, [28.0]), (ASCII, b"28\0"),
     (ASCII, b"28 mm\0"), (ASCII, b" 28.0\0"), (ASCII, b"28,0 mm\0"), (ASCII, b"56/2\0"), (UNDEFINED, b"28\0"),
     (SHORT, [28, 0]), (SHORT, [28, 28]), (RATIONAL, [28, 1, 0, 0])],
)  # fmt: skip
def test_the_35mm_equivalent_in_any_type(tmp_path, value):
    assert read_photo(with_tags(tmp_path / "p.jpg", exif={F35: value})).exif_focal_px == pytest.approx(IN_PIXELS)


@pytest.mark.parametrize("value", [(SHORT, [0]), (SHORT, [65535]), (RATIONAL, [28, 0]), (ASCII, b"wide\0")])
def test_an_odd_35mm_equivalent_leaves_the_focal_plane(tmp_path, value):
    plane = {exif_tags.FOCAL_LENGTH: (RATIONAL, [6, 1]), exif_tags.PLANE_X_RESOLUTION: (RATIONAL, [254, 1]),
             exif_tags.PLANE_UNIT: (SHORT, [2])}  # fmt: skip
    assert read_photo(with_tags(tmp_path / "p.jpg", exif=plane | {F35: value})).exif_focal_px == pytest.approx(60)


@pytest.mark.parametrize("kind", ["jpg", "png", "webp"])
@pytest.mark.parametrize(
    ("value", "turned"),
    [((SHORT, [6]), True), ((BYTE, b"\6"), True), ((BYTE, b"\6\0"), True), ((LONG, [6]), True), ((SSHORT, [6]), True),
     ((SLONG, [6]), True), ((UNDEFINED, b"\6"), True), ((RATIONAL, [6, 1]), True), ((ASCII, b"6\0"), True),
     ((SHORT, [6, 6]), True), ((DOUBLE, [6.0]), True), ((SHORT, [0]), False), ((SHORT, [9]), False),
     ((SSHORT, [-6]), False), ((LONG, [2**32 - 1]), False), ((RATIONAL, [6, 0]), False), ((DOUBLE, [6.5]), False),
     ((ASCII, b"Rotate 90 CW\0"), False), ((UNDEFINED, b"\xff"), False), ((SHORT, []), False)],
)  # fmt: skip
def test_an_orientation_of_any_type(tmp_path, kind, value, turned):
    photo = read_photo(path := with_tags(tmp_path / f"p.{kind}", main={0x0112: value}))
    header = read_header(path)
    assert (photo.width, photo.height) == (header.width, header.height) == ((64, 96) if turned else (96, 64))


@pytest.mark.parametrize("kind", ["jpg", "png", "webp"])
@pytest.mark.parametrize("cut", [0, 1, 5, 8, 9, 10, 20, 30, 40, 60])
def test_a_block_that_was_cut_or_overwritten_is_no_reason_to_refuse(tmp_path, kind, cut):
    whole = exif_bytes(main={0x0112: (SHORT, [6])}, exif={F35: (SHORT, [28])}, gps={1: (ASCII, b"S\0")})[6:]
    for exif in (whole[:cut], whole[:cut] + bytes(len(whole) - cut), whole[:cut] + b"\xff" * (len(whole) - cut)):
        Image.new("RGB", (96, 64)).save(tmp_path / f"p.{kind}", exif=b"Exif\0\0" + exif)
        assert read_header(tmp_path / f"p.{kind}").bytes > 0
        assert read_photo(tmp_path / f"p.{kind}").image.shape[2] == 3
