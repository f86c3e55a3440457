import math

import pytest
from data.photos.pictures import exif_with, save, scene

from sextant.data.photos import exif as exif_tags
from sextant.data.photos import exif_focal_px, read_photo


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
