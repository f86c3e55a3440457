import json
import math

import numpy as np
import pytest
from calibration_toy import distribution, panorama
from PIL import Image

from sextant.chapters.calibration.data.known_photos import known_photos
from sextant.errors import UserError


def save(path, size=(80, 60), **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, (90, 120, 60)).save(path, **options)


def of(folder, **options):
    return list(known_photos(folder, distribution(), **options))


def test_photos_with_a_table(tmp_path):
    save(tmp_path / "a.png")
    save(tmp_path / "b.png", (60, 80))
    (tmp_path / "mine.csv").write_text(
        "file,f_px,f_sfm_px,tilt_deg,roll_deg,k1,model,source_owner\na.png,90,,10,-5,-0.1,X,me\nb.png,88,80,,,,X,me\n"
    )
    (tmp_path / "licences.csv").write_text("file,licence\na.png,CC0\n")
    first, second = of(tmp_path)
    assert (first.name, first.image.shape, first.cluster) == ("a.png", (60, 80, 3), second.cluster)
    assert (first.tilt, first.roll, first.focal, first.k1) == pytest.approx(
        (math.radians(10), math.radians(-5), 1.5, -0.1)
    )
    assert second.focal == 1  # by structure from motion, in heights of the upright photo
    assert math.isnan(second.tilt)
    assert math.isnan(second.k1)


def test_panoramas_are_cut_evenly_around(tmp_path):
    Image.fromarray(panorama(np.random.default_rng(0), 128)).save(tmp_path / "p.png")
    (tmp_path / "list.csv").write_text("file,place\np.png,indoor\n")
    cut, again = of(tmp_path, cuts=3), of(tmp_path, cuts=3)
    assert [photo.name for photo in cut] == ["p.png#0", "p.png#1", "p.png#2"]
    assert {photo.cluster for photo in cut} == {"p.png"}
    assert all(np.array_equal(a.image, b.image) and a.tilt == b.tilt for a, b in zip(cut, again, strict=True))
    assert not np.array_equal(cut[0].image, cut[1].image)
    assert all(min(photo.image.shape[:2]) == 360 for photo in cut)
    assert [photo.tilt for photo in of(tmp_path, cuts=3, seed=1)] != [photo.tilt for photo in cut]


def test_lenses_known_by_other_files(tmp_path):
    save(tmp_path / "board" / "1.png")
    board = {"K": [[66, 0, 40], [0, 66, 30], [0, 0, 1]], "dist": [-0.3, 0.1, 0, 0, 0]}
    (tmp_path / "board" / "calibration_computed.json").write_text(json.dumps(board))
    save(tmp_path / "castle" / "1.png")
    (tmp_path / "castle" / "K.txt").write_text("78 0 40\n0 78 30\n0 0 1\n")
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA405] = 26
    save(tmp_path / "street" / "1.jpg", exif=block)
    save(tmp_path / "street" / "2.jpg")  # of which nothing is known
    found = of(tmp_path)
    assert [photo.focal for photo in found] == pytest.approx([1.1, 1.3, 26 * 100 / math.hypot(36, 24) / 60])
    assert [photo.k1 for photo in found] == pytest.approx([-0.3, math.nan, math.nan], nan_ok=True)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda folder: None, "does not exist"),
        (lambda folder: folder.mkdir(), "no photo there"),
        (lambda folder: save(folder / "a.jpg"), "has no photo of a known camera"),
    ],
)
def test_what_is_missing_is_told(tmp_path, make, says):
    make(tmp_path / "photos")
    with pytest.raises(UserError, match=says):
        of(tmp_path / "photos")


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("a.png,long,0", r"line 2: f_px=long of a\.png must be a number from 1 to 1,000,000"),
        *(
            (f"a.png,90,0\nb.png,{value},0", f"line 3: f_px={value} of b")
            for value in ("-674.9", "0", "nan", "inf", "")
        ),
        ("a.png,90,1000", r"line 2: tilt_deg=1000 of a\.png must be a number from -90 to 90"),
        ("a.png,90,0\nb.png,90,0\n./a.png,90,0", r"line 4: \./a\.png is already listed in line 2"),
        ("a.png,90,0\nnope.png,90,0", r"t\.csv cannot be used as it is\n  line 3: nope\.png: no such file in"),
    ],
)
def test_lines_of_a_table_that_cannot_be_used_are_told_before_a_photo_is_read(tmp_path, rows, says):
    for name in ("a.png", "b.png"):
        save(tmp_path / name)
    (tmp_path / "t.csv").write_text(f"file,f_px,tilt_deg\n{rows}\n")
    with pytest.raises(UserError, match=says):
        next(known_photos(tmp_path, distribution()))


@pytest.mark.parametrize(
    ("size", "fits"), [("80,60", True), ("60,80", True), ("80.0,60.0", True), (",", True), ("160,120", False)]
)
def test_focal_lengths_of_photos_of_another_size_are_refused(tmp_path, size, fits):
    save(tmp_path / "a.png")
    (tmp_path / "t.csv").write_text(f"file,f_px,width,height\na.png,90,{size}\n")
    if fits:
        assert len(of(tmp_path)) == 1
    else:
        with pytest.raises(UserError, match=r"a\.png has 80x60 pixels, but its row says 160x120"):
            of(tmp_path)


def test_photos_that_cannot_be_read_are_left_out_with_the_reason(tmp_path):
    save(tmp_path / "b.png")
    (tmp_path / "a.png").write_text("text")
    (tmp_path / "t.csv").write_text("file, f_px\na.png, 90\nb.png, 90\n")
    (tmp_path / "more.csv").mkdir()
    skipped = {}
    assert [photo.name for photo in of(tmp_path, skipped=skipped)] == ["b.png"]
    assert "cannot be decoded" in skipped[str(tmp_path / "a.png")]
    with pytest.raises(UserError, match=r"none of its photos of known cameras can be read\n.*a\.png"):
        of(tmp_path, leave_out=["b*"])


def test_photos_beside_folders_are_read_first_and_folders_without_photos_skipped(tmp_path):
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA405] = 26
    save(tmp_path / "1.jpg", exif=block)
    save(tmp_path / "more" / "2.jpg", exif=block)
    (tmp_path / "benchmark").mkdir()
    found = of(tmp_path)
    assert [photo.name for photo in found] == ["1.jpg", "2.jpg"]
    assert len({photo.cluster for photo in found}) == 2


def test_photos_of_one_lens_are_not_independent_and_some_can_be_left_out(tmp_path):
    for name in ("a1.png", "a2.png", "b1.png"):
        save(tmp_path / name)
    (tmp_path / "K.txt").write_text("78 0 40\n0 78 30\n0 0 1\n")
    found = of(tmp_path, leave_out=("b*",))
    assert [photo.name for photo in found] == ["a1.png", "a2.png"]
    assert found[0].cluster == found[1].cluster
    with pytest.raises(UserError, match="no photo of a known camera that is not left out"):
        of(tmp_path, leave_out=("*",))


def test_a_table_of_files_that_are_no_panoramas_is_of_something_else(tmp_path):
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA405] = 26
    save(tmp_path / "a.jpg", exif=block)
    (tmp_path / "licences.csv").write_text("file,licence\na.jpg,CC0\n")
    assert [photo.name for photo in of(tmp_path)] == ["a.jpg"]
    (tmp_path / "cameras.csv").write_text("file,tilt_deg\na.jpg,3\n")
    with pytest.raises(UserError, match=r"cameras\.csv has a column tilt_deg, but no column f_px"):
        of(tmp_path)


def test_panoramas_of_one_scene_are_not_independent_and_a_photo_among_them_is_named(tmp_path):
    for name in ("p.png", "q.png"):
        Image.fromarray(panorama(np.random.default_rng(0), 64)).save(tmp_path / name)
    (tmp_path / "list.csv").write_text("\ufefffile,cluster\np.png,house\nq.png,house\n", encoding="utf-8")
    assert {photo.cluster for photo in of(tmp_path, cuts=1)} == {"house"}
    save(tmp_path / "a.jpg")
    (tmp_path / "list.csv").write_text("file\na.jpg\np.png\n")
    with pytest.raises(UserError, match=r"line 2: a\.jpg is not a panorama: its sides are not 2:1"):
        of(tmp_path, cuts=1)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("t.csv", b"file,f_px,f_px\na.png,90,91\n", r"t\.csv has 2 columns named f_px"),
        ("t.csv", b"file,f_px\n,90\n", "line 2 has no file"),
        ("t.csv", b"file,f_px\n\xff\xfe,90\n", "cannot be read: byte 10 is not text in UTF-8"),
        ("t.csv", b"file,f_px\na.png,90,5\n", "line 2: 3 values for 2 columns: decimal commas"),
        ("calibration_computed.json", b"{", "has no focal length of a camera"),
        ("calibration_computed.json", b'{"K": []}', "has no focal length of a camera"),
        ("K.txt", b"", "has no focal length of a camera"),
        ("K.txt", b"f 0 1", "has no focal length of a camera"),
    ],
)
def test_a_broken_file_is_one_message(tmp_path, name, content, says):
    save(tmp_path / "a.png")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=says):
        of(tmp_path)
