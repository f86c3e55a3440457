"""Positions in EXIF and XMP, of every type, sign, count and padding that programs write.

The boundaries of the kind: the type of a reference (ASCII with and without NUL, UNDEFINED, BYTE, SHORT), its spelling
(letter, word, case, padding) and its absence; values of one to three parts, of every type; signs with, against and
without a reference; denominators of zero; the ends of the range; references of altitudes; and no block at all.
"""

import numpy as np
import pytest
from data.photos.tags import (
    ASCII,
    BYTE,
    DOUBLE,
    FLOAT,
    LONG,
    RATIONAL,
    SHORT,
    SLONG,
    SRATIONAL,
    UNDEFINED,
    exif_bytes,
    with_tags,
)
from PIL import Image

from sextant.chapters.places.data.gps_poses import gps_poses
from sextant.data.photos.gps import gps_position, photo_gps
from sextant.errors import ArgumentError

LATITUDE, LONGITUDE = -33.8568, 151.2153
SOUTH, EAST = (ASCII, b"S\0"), (ASCII, b"E\0")
DEGREES_S = (RATIONAL, [33, 1, 51, 1, 2448, 100])
DEGREES_E = (RATIONAL, [151, 1, 12, 1, 5508, 100])
BLOCK = {1: SOUTH, 2: DEGREES_S, 3: EAST, 4: DEGREES_E}

REFERENCES = {
    "letter": SOUTH,
    "ascii without NUL": (ASCII, b"S"),
    "undefined": (UNDEFINED, b"S\0"),
    "undefined alone": (UNDEFINED, b"S"),
    "bytes": (BYTE, b"S\0"),
    "byte": (BYTE, b"S"),
    "code": (SHORT, [ord("S")]),
    "codes": (SHORT, [ord("S"), 0]),
    "lower case": (ASCII, b"s\0"),
    "word": (ASCII, b"South\0"),
    "word in lower case": (ASCII, b"south\0"),
    "words": (ASCII, b"South latitude\0"),
    "spaces before": (ASCII, b"  S\0"),
    "spaces after": (ASCII, b"S   \0"),
    "NUL before": (ASCII, b"\0S\0"),
    "junk after NUL": (ASCII, b"S\0\xff\x12\0"),
    "padded with NUL": (ASCII, b"S\0\0\0\0\0"),
    "capital word": (UNDEFINED, b"SOUTH"),
}
VALUES = {
    "three rationals": DEGREES_S,
    "two rationals": (RATIONAL, [33, 1, 51408, 1000]),
    "one rational": (RATIONAL, [338568, 10000]),
    "rational and zeros": (RATIONAL, [338568, 10000, 0, 1, 0, 1]),
    "signed rationals": (SRATIONAL, [33, 1, 51, 1, 2448, 100]),
    "negative rational": (SRATIONAL, [-338568, 10000, 0, 1, 0, 1]),
    "all parts negative": (SRATIONAL, [-33, 1, -51, 1, -2448, 100]),
    "first part negative": (SRATIONAL, [-33, 1, 51, 1, 2448, 100]),
    "negative denominators": (SRATIONAL, [33, -1, 51, -1, 2448, -100]),
    "doubles": (DOUBLE, [33.0, 51.0, 24.48]),
    "one double": (DOUBLE, [33.8568]),
    "negative double": (DOUBLE, [-33.8568]),
    "floats": (FLOAT, [33.0, 51.0, 24.48]),
    "numerators and denominators": (LONG, [33, 1, 51, 1, 2448, 100]),
    "text": (ASCII, b"33.8568\0"),
    "signed text": (ASCII, b"-33.8568\0"),
    "text with units": (ASCII, b"33 deg 51' 24.48\"\0"),
    "text with a letter": (ASCII, b"33 51 24.48 S\0"),
    "text of fractions": (ASCII, b"33/1,51/1,2448/100\0"),
    "decimal comma": (ASCII, b"33,8568\0"),
    "text as bytes": (UNDEFINED, b"33.8568"),
}


def position(gps, order="<", xmp=b""):
    exif = Image.Exif()
    if gps is not None:
        exif.load(exif_bytes(gps=gps, order=order))
    return gps_position(exif, xmp)


def check(found, doubt=None):
    assert found.position is not None, found.problem
    assert found.position[:2] == (pytest.approx(LATITUDE, abs=1e-5), pytest.approx(LONGITUDE, abs=1e-5))
    assert (doubt or "") in found.problem
    assert bool(doubt) == bool(found.problem)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", REFERENCES)
def test_a_reference_of_any_type_and_spelling(name, order):
    check(position(BLOCK | {1: REFERENCES[name]}, order))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", VALUES)
def test_a_value_of_any_type_count_and_sign(name, order):
    check(position(BLOCK | {2: VALUES[name]}, order))


@pytest.mark.parametrize(
    ("lacking", "reference"),
    [("no reference", None), ("no reference", (ASCII, b"\0")), ("no reference", (ASCII, b"  \0")),
     ("'X' as its reference", (ASCII, b"X\0")), ("'E' as its reference", (ASCII, b"E\0")),
     ("'7' as its reference", (SHORT, [7]))],
)  # fmt: skip
def test_a_value_without_a_reference_is_a_doubt_and_names_the_assumption(lacking, reference):
    block = {tag: value for tag, value in BLOCK.items() if tag != 1} | ({1: reference} if reference else {})
    found = position(block)
    assert found.position.latitude_deg == pytest.approx(-LATITUDE)
    assert found.problem == f"its latitude has {lacking}: taken as north"


def test_a_sign_needs_no_reference_and_wins_over_a_contrary_one():
    signed = {2: (SRATIONAL, [-338568, 10000]), 4: DEGREES_E, 3: EAST}
    check(position(signed))
    check(position(signed | {1: SOUTH}))
    check(
        position(signed | {1: (ASCII, b"N\0")}), "its latitude -33.8568 is negative, its reference 'N': taken as south"
    )
    west = position({2: (ASCII, b"+33.8568\0"), 4: (ASCII, b"-151.2153\0")})
    assert west.position[:2] == (pytest.approx(33.8568), pytest.approx(-151.2153))
    assert west.problem == ""


REFUSED = {
    "degrees of 0/0": ({2: (RATIONAL, [0, 0, 51, 1, 0, 1])}, "its latitude ? 51 0 cannot be read"),
    "infinite degrees": ({2: (RATIONAL, [33, 0, 51, 1, 0, 1])}, "cannot be read"),
    "minutes of 0/0": ({2: (RATIONAL, [33, 1, 0, 0, 0, 1])}, "its latitude 33 ? 0 cannot be read"),
    "not a number": ({2: (DOUBLE, [float("nan")])}, "cannot be read"),
    "infinite": ({2: (DOUBLE, [float("inf")])}, "cannot be read"),
    "words": ({2: (ASCII, b"unknown\0")}, "its latitude is missing or cannot be read"),
    "bytes of numbers": ({2: (UNDEFINED, bytes(range(24)))}, "cannot be read"),
    "beyond the pole": ({2: (RATIONAL, [91, 1])}, "its latitude 91 is beyond 90 degrees"),
    "just beyond the pole": ({2: (RATIONAL, [90, 1, 0, 1, 1, 1])}, "beyond 90 degrees"),
    "beyond the date line": ({4: (RATIONAL, [18001, 100])}, "its longitude 180.01 is beyond 180 degrees"),
    "61 minutes": ({2: (RATIONAL, [33, 1, 61, 1, 0, 1])}, "more than 60 minutes or seconds"),
    "scaled seconds": ({2: (RATIONAL, [33, 1, 51, 1, 2448, 1])}, "its latitude 33 51 2448 has more than 60"),
    "no longitude": ({4: None}, "its longitude is missing"),
    "no fix": ({2: (RATIONAL, [0, 1, 0, 1, 0, 1]), 4: (RATIONAL, [0, 1, 0, 1, 0, 1])}, "0, 0"),
    "huge": ({2: (RATIONAL, [2**32 - 1, 1])}, "beyond 90 degrees"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_position_that_cannot_be_right_is_left_out_with_the_reason(name):
    changed, reason = REFUSED[name]
    found = position({tag: value for tag, value in (BLOCK | changed).items() if value is not None})
    assert found.position is None
    assert reason in found.problem


def test_the_ends_of_the_range_are_positions():
    block = BLOCK | {2: (RATIONAL, [90, 1, 0, 1, 0, 1]), 4: (RATIONAL, [180, 1, 0, 1, 0, 1])}
    assert position(block).position[:2] == (-90, 180)
    assert position(BLOCK | {2: (RATIONAL, [0, 1, 0, 1, 0, 1])}).position.latitude_deg == 0


def test_seconds_without_a_value_and_mixed_fractions_are_doubts():
    found = position(BLOCK | {2: (RATIONAL, [33, 1, 51, 1, 0, 0])})
    assert found.position.latitude_deg == pytest.approx(-33.85)
    assert found.problem == "the seconds of its latitude cannot be read: taken as 0"
    assert "fractions before smaller units" in position(BLOCK | {2: (DOUBLE, [33.8568, 51.4, 24.0])}).problem


ALTITUDES = {
    "above": ((BYTE, b"\0"), [50, 1], 50), "below": ((BYTE, b"\1"), [50, 1], -50),
    "below the sea (Exif 3.0)": ((BYTE, b"\3"), [50, 1], -50), "above the sea (Exif 3.0)": ((BYTE, b"\2"), [50, 1], 50),
    "short": ((SHORT, [1]), [50, 1], -50), "ascii": ((ASCII, b"1\0"), [50, 1], -50),
    "ascii zero": ((ASCII, b"0\0"), [50, 1], 50), "undefined": ((UNDEFINED, b"\1\0"), [50, 1], -50),
    "control character": ((ASCII, b"\1\0"), [50, 1], -50), "words": ((ASCII, b"Below sea level\0"), [50, 1], -50),
    "signed": (None, [-50, 1], -50), "signed and below": ((BYTE, b"\1"), [-50, 1], -50),
    "none": (None, [50, 1], 50), "broken": ((BYTE, b"\0"), [50, 0], None), "in space": (None, [999999, 1], None),
}  # fmt: skip


@pytest.mark.parametrize("name", ALTITUDES)
def test_altitudes_by_any_reference(name):
    reference, value, metres = ALTITUDES[name]
    found = position(BLOCK | {6: (SRATIONAL, value)} | ({5: reference} if reference else {}))
    check(found, "its altitude of 999,999 m is left out" if name == "in space" else None)
    assert found.position.altitude_m == metres


@pytest.mark.parametrize(
    ("xmp", "doubt"),
    [(b'exif:GPSLatitude="33,51.408S" exif:GPSLongitude="151,12,55.08E"', None),
     (b"<exif:GPSLatitude>33,51,24.48S</exif:GPSLatitude><exif:GPSLongitude>151,12.918E</exif:GPSLongitude>", None),
     (b'drone-dji:GpsLatitude="-33.8568" drone-dji:GpsLongtitude="+151.2153"', None),
     (b'drone-dji:GpsLatitude="-33.8568" drone-dji:GpsLongitude="151.2153"', "its longitude has no reference")],
)  # fmt: skip
def test_xmp_speaks_where_exif_has_no_position(xmp, doubt):
    check(position(None, xmp=xmp), doubt)
    check(position({6: (RATIONAL, [5, 1])}, xmp=xmp), doubt)
    check(position(BLOCK, xmp=xmp.replace(b"33", b"34")))


def test_no_block_is_no_problem_and_one_odd_tag_costs_only_itself():
    assert position(None) == (None, "")
    assert position({6: (RATIONAL, [5, 1])}) == (None, "")
    odd = {17: (ASCII, b"north\0"), 16: (SLONG, [-1]), 6: (ASCII, b"high\0"), 0x1D: (RATIONAL, [1, 0])}
    found = position(BLOCK | odd)
    check(found)
    assert (found.position.altitude_m, found.position.direction_deg) == (None, None)


def test_doubts_are_notes_and_reasons_are_in_the_error(tmp_path):
    good = with_tags(tmp_path / "a.jpg", gps=BLOCK)
    guess = with_tags(tmp_path / "b.jpg", gps={2: DEGREES_S, 4: DEGREES_E})
    bad = with_tags(tmp_path / "c.jpg", gps=BLOCK | {2: (RATIONAL, [91, 1])})
    notes = []
    poses = gps_poses([good, guess], "places=gps", notes)
    assert np.hypot(poses[1].x, poses[1].y) > 5e6  # the other hemisphere
    assert notes == [
        "places=gps: the positions of 1 of 2 images are doubtful, such as b.jpg: its latitude has no reference: taken "
        "as north; its longitude has no reference: taken as east"
    ]
    with pytest.raises(ArgumentError, match=r"1 of 2 images has no GPS.*\n.*c\.jpg: its latitude 91 is beyond"):
        gps_poses([good, bad], "places=gps")
    assert photo_gps(tmp_path / "none.jpg") == (None, "")
