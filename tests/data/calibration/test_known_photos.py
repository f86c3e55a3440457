import json
import math

import numpy as np
import pytest
from calibration_toy import distribution, panorama
from PIL import Image

from sextant.data.calibration.known_photos import known_photos
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
        (lambda folder: None, "no such folder"),
        (lambda folder: folder.mkdir(), "no photo there"),
        (lambda folder: save(folder / "a.jpg"), "has no photo of a known camera"),
    ],
)
def test_what_is_missing_is_told(tmp_path, make, says):
    make(tmp_path / "photos")
    with pytest.raises(UserError, match=says):
        of(tmp_path / "photos")


def test_a_value_that_is_no_number_is_named(tmp_path):
    (tmp_path / "t.csv").write_text("file,f_px\na.png,long\n")
    with pytest.raises(UserError, match=r"the row of a\.png has a value that is no number"):
        of(tmp_path)
