import contextlib
import math
import struct
import warnings
import zlib

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sextant.data import photos
from sextant.data.photos import exif_focal_px, network_view, read_photo, straight_focal, undistort_photo
from sextant.errors import UserError
from sextant.geometry import undistort_radius

ORIENTATION, EXIF_BLOCK = 0x0112, 0x8769
UPRIGHT = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a.swapaxes(0, 1)[::-1, ::-1],
    8: lambda a: np.rot90(a, 1),
}


def scene(width=96, height=64, channels=3):
    """Smooth, and different in each corner and channel."""
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    planes = [60 + 150 * x, 40 + 180 * y, 220 - 90 * x - 90 * y, np.full_like(x, 255)]
    return np.stack(planes[:channels], -1).round().astype(np.uint8)


def save(path, image, **options):
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path, **options)
    return path


def exif_with(orientation=None, **block):
    exif = Image.Exif()
    if orientation:
        exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF_BLOCK).update({getattr(photos, name): value for name, value in block.items()})
    return exif


# -- decoding ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["png", "jpg", "tif", "webp"])
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_a_photo_is_turned_upright(tmp_path, kind, orientation):
    pixels = scene()
    options = {"webp": {"lossless": True}, "jpg": {"quality": 100, "subsampling": 0}}.get(kind, {})
    photo = read_photo(save(tmp_path / f"p.{kind}", pixels, exif=exif_with(orientation), **options))
    upright = UPRIGHT[orientation](pixels)
    assert (photo.height, photo.width) == upright.shape[:2] == photo.image.shape[:2]
    assert np.abs(photo.image.astype(int) - upright).max() <= (4 if kind == "jpg" else 0)
    assert photo.orientation == orientation
    assert photo.scale == 1


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_is_ignored(tmp_path, orientation):
    photo = read_photo(save(tmp_path / "p.png", scene(), exif=exif_with(orientation)))
    np.testing.assert_array_equal(photo.image, scene())


def test_grey_has_three_equal_channels(tmp_path):
    photo = read_photo(save(tmp_path / "p.png", scene()[..., 0]))
    np.testing.assert_array_equal(photo.image, np.repeat(scene()[..., :1], 3, 2))


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("kind", ["png", "tif"])
def test_more_than_eight_bits_become_eight(tmp_path, kind, bits):
    grey = np.linspace(0, (1 << bits) - 1, 64 * 96).round().astype(np.uint16).reshape(64, 96)
    photo = read_photo(save(tmp_path / f"p.{kind}", grey))
    np.testing.assert_array_equal(photo.image[..., 0], grey >> (bits - 8))


def test_sixteen_bit_colour_keeps_its_high_bytes(tmp_path):
    colour = scene().astype(np.uint16) * 257
    assert cv2.imwrite(str(tmp_path / "p.png"), colour[..., ::-1])
    np.testing.assert_array_equal(read_photo(tmp_path / "p.png").image, scene())


@pytest.mark.parametrize("top", [1.0, 255.0, 4000.0])
def test_floating_point_is_scaled_to_bytes(tmp_path, top):
    values = np.linspace(0, top, 64 * 96, dtype=np.float32).reshape(64, 96)
    values[0, 0] = np.nan
    image = read_photo(save(tmp_path / "p.tif", values)).image
    assert image.max() == 255
    assert np.abs(image[..., 0] - np.nan_to_num(values) * 255 / top).max() <= 0.51


def test_what_is_transparent_becomes_mid_grey(tmp_path):
    rgba = scene(channels=4)
    rgba[:32, :, 3] = 0
    rgba[32:, :48, 3] = 128
    image = read_photo(save(tmp_path / "p.png", rgba)).image.astype(float)
    assert (image[:32] == 128).all()
    np.testing.assert_array_equal(image[32:, 48:], scene()[32:, 48:])
    np.testing.assert_allclose(image[32:, :48], (scene()[32:, :48].astype(float) + 128) / 2, atol=1.1)


def test_grey_with_alpha_and_palettes_with_a_transparent_colour(tmp_path):
    grey = Image.merge("LA", [Image.new("L", (40, 40), 200), Image.new("L", (40, 40), 0)])
    assert (read_photo(save(tmp_path / "a.png", grey)).image == 128).all()
    palette = Image.fromarray(scene()).quantize(16)
    colours = np.asarray(palette.convert("RGB"))
    np.testing.assert_array_equal(read_photo(save(tmp_path / "b.png", palette)).image, colours)
    hidden = np.asarray(palette) == 3
    image = read_photo(save(tmp_path / "c.png", palette, transparency=3)).image
    assert (image[hidden] == 128).all()
    np.testing.assert_array_equal(image[~hidden], colours[~hidden])


def test_cmyk_black_and_white_and_the_first_of_several_pictures(tmp_path):
    cmyk = Image.fromarray(scene()).convert("CMYK")
    image = read_photo(save(tmp_path / "c.jpg", cmyk, quality=100, subsampling=0)).image
    assert np.abs(image.astype(int) - scene()).max() <= 4
    bits = Image.fromarray(scene()[..., 0]).convert("1")
    np.testing.assert_array_equal(read_photo(save(tmp_path / "1.png", bits)).image[..., 0], np.asarray(bits) * 255)
    first, second = Image.new("RGB", (40, 40), (0, 0, 0)), Image.new("RGB", (40, 40), (255, 255, 255))
    first.save(tmp_path / "a.gif", save_all=True, append_images=[second])
    assert (read_photo(tmp_path / "a.gif").image == 0).all()


def test_broken_metadata_is_no_reason_to_refuse_a_photo(tmp_path):
    path = save(tmp_path / "p.jpg", scene(), exif=exif_with(6, FOCAL_35MM=28))
    content = bytearray(path.read_bytes())
    start = content.index(b"Exif\0\0") + 6
    content[start + 4 : start + 8] = b"\xff\xff\xff\x7f"  # the offset of its first directory
    path.write_bytes(content)
    photo = read_photo(path)
    assert photo.orientation == 1
    assert photo.exif_focal_px is None


# -- bad files ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (b"not a picture", "cannot be read"), (b"%!PS-Adobe-3.0 EPSF-3.0\n", "cannot be read")],
)
def test_what_is_no_picture_is_named(tmp_path, content, says):
    (tmp_path / "p.jpg").write_bytes(content)
    with pytest.raises(UserError, match=says) as raised:
        read_photo(tmp_path / "p.jpg")
    assert "p.jpg" in raised.value.problem
    assert raised.value.fix


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path in (tmp_path / "none.jpg", tmp_path):
        with pytest.raises(UserError, match="no such file"):
            read_photo(path)


def test_a_format_of_phones_that_is_not_decoded_is_explained(tmp_path):
    (tmp_path / "p.heic").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
    with pytest.raises(UserError, match="cannot be read") as raised:
        read_photo(tmp_path / "p.heic")
    assert "JPEG" in raised.value.fix


@pytest.mark.parametrize("kind", ["jpg", "png", "tif", "webp", "gif", "bmp", "jp2"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
def test_a_truncated_photo_is_refused(tmp_path, kind, share):
    noise = np.random.default_rng(0).integers(256, size=(64, 96, 3), dtype=np.uint8)
    path = save(tmp_path / f"p.{kind}", noise)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(UserError, match="cannot be read"):
        read_photo(path)


@pytest.mark.parametrize("kind", ["jpg", "png", "tif", "webp", "gif", "bmp", "jp2"])
def test_damaged_bytes_never_raise_anything_else(tmp_path, kind):
    rng = np.random.default_rng(1)
    original = save(tmp_path / f"p.{kind}", scene()).read_bytes()
    path = tmp_path / f"damaged.{kind}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(60):
            damaged = bytearray(original)
            for place in rng.integers(len(damaged), size=8):
                damaged[place] = rng.integers(256)
            path.write_bytes(damaged)
            with contextlib.suppress(UserError):
                assert read_photo(path).image.shape[2] == 3


@pytest.mark.parametrize("size", [(1, 1), (31, 400), (400, 31)])
def test_a_photo_that_is_too_small_is_refused_with_its_size(tmp_path, size):
    path = save(tmp_path / "p.png", Image.new("RGB", size))
    with pytest.raises(UserError, match=f"{size[0]}x{size[1]} pixels.*at least 32"):
        read_photo(path)


# -- very large photos -------------------------------------------------------------------------------------------------


def blank_png(path, width, height):
    """A grey PNG of any size, written without holding it in memory."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer, packed = zlib.compressobj(1), b""
    for _ in range(height):
        packed += packer.compress(b"\0" + bytes(width))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", packed + packer.flush()) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    return path


@pytest.mark.parametrize("kind", ["jpg", "png", "tif"])
@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("limit", [24_000, 9_000, 3_000])
def test_a_photo_over_the_limit_is_decoded_smaller_and_told_in_original_pixels(
    tmp_path, monkeypatch, kind, orientation, limit
):
    monkeypatch.setattr(photos, "LARGEST_DECODED", limit)
    options = {"quality": 95} if kind == "jpg" else {}
    exif = exif_with(orientation, FOCAL_35MM=28)
    photo = read_photo(save(tmp_path / f"p.{kind}", scene(240, 160), exif=exif, **options))
    upright = UPRIGHT[orientation](scene(240, 160))
    assert (photo.width, photo.height) == upright.shape[1::-1]
    rows, columns = photo.image.shape[:2]
    assert limit / 6 < rows * columns <= 1.05 * limit
    assert photo.scale == pytest.approx(rows / photo.height, rel=0.03)
    reference = cv2.resize(np.ascontiguousarray(upright), (columns, rows), interpolation=cv2.INTER_AREA)
    assert np.abs(photo.image.astype(int) - reference).mean() < 3
    if kind != "tif":  # Pillow does not write the block into one
        assert photo.exif_focal_px == pytest.approx(28 / math.hypot(36, 24) * math.hypot(240, 160))


def test_a_photo_of_a_hundred_megapixels_is_read_and_pillows_limit_is_left_alone(tmp_path):
    limit = Image.MAX_IMAGE_PIXELS
    photo = read_photo(blank_png(tmp_path / "p.png", 12_500, 8_000))
    assert (photo.width, photo.height) == (12_500, 8_000)
    assert photo.image.shape == (4000, 6250, 3)
    assert limit == Image.MAX_IMAGE_PIXELS


def test_a_bomb_is_refused_before_it_is_decoded(tmp_path):
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + b"IHDR" + header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    idat = struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))
    (tmp_path / "p.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk + idat)
    with pytest.raises(UserError, match=r"60000x60000 pixels .3600 megapixels.; PNG is decoded up to 256"):
        read_photo(tmp_path / "p.png")


# -- focal length by EXIF ----------------------------------------------------------------------------------------------


def test_the_35mm_equivalent_compares_diagonals(tmp_path):
    photo = read_photo(save(tmp_path / "p.jpg", scene(), exif=exif_with(FOCAL_35MM=50)))
    assert photo.exif_focal_px == pytest.approx(50 * math.hypot(96, 64) / math.hypot(36, 24))
    assert photo.exif_focal_px == pytest.approx(50 / 36 * 96)  # a photo of 3:2, as the film


@pytest.mark.parametrize(("unit", "per_mm"), [(2, 25.4), (3, 10.0), (4, 1.0)])
def test_the_resolution_of_the_focal_plane_in_any_unit(unit, per_mm):
    exif = {
        photos.FOCAL_LENGTH: 6.0,
        photos.PLANE_X_RESOLUTION: 500.0 * per_mm,
        photos.PLANE_UNIT: unit,
        photos.PIXELS_X: 4000.0,
        photos.PIXELS_Y: 3000.0,
    }
    assert exif_focal_px(exif, 4000, 3000) == pytest.approx(3000)
    assert exif_focal_px(exif, 2000, 1500) == pytest.approx(1500)  # scaled since
    assert exif_focal_px(exif, 3000, 4000) == pytest.approx(3000)  # turned since
    assert exif_focal_px(exif, 3000, 3000) is None  # cropped since


@pytest.mark.parametrize("value", [0, 1e-9, 1e9])
def test_a_focal_length_that_no_lens_has_is_none(tmp_path, value):
    exif = {photos.FOCAL_35MM: float(value)}
    assert exif_focal_px(exif, 4000, 3000) is None


def test_photos_of_a_castle_tell_their_focal_length(real_data):
    for path in sorted((real_data / "photos" / "sceaux_castle").glob("*.JPG")):
        assert read_photo(path).exif_focal_px == pytest.approx(2905.88, rel=0.02)  # K.txt


# -- what the network sees ---------------------------------------------------------------------------------------------

ASPECTS = (1.0, 1.25, 4 / 3, 1.5, 16 / 9)


@given(st.integers(32, 500), st.integers(32, 500))
def test_the_part_is_the_largest_centred_one_of_a_trained_aspect(width, height):
    photo = photos.Photo(np.zeros((height, width, 3), np.uint8), width, height, 1, None)
    view = network_view(photo, ASPECTS, 24, 18)
    assert view.image.shape == (18, 24, 3)
    assert view.width / view.height == pytest.approx(view.aspect)
    assert view.aspect in ASPECTS
    assert view.left == pytest.approx((width - view.width) / 2)
    assert view.top == pytest.approx((height - view.height) / 2)
    assert min(view.left, view.top) == pytest.approx(0, abs=1e-9)
    shares = [min(a * height, width) * min(width / a, height) / (width * height) for a in ASPECTS]
    assert view.share == pytest.approx(max(shares))


def test_a_portrait_photo_is_cut_to_its_full_width():
    photo = photos.Photo(np.zeros((400, 300, 3), np.uint8), 300, 400, 1, None)
    view = network_view(photo, (4 / 3,), 24, 18)
    assert (view.left, view.width) == (0, 300)
    assert (view.top, view.height) == (87.5, 225)


@pytest.mark.parametrize("size", [(480, 360), (481, 367), (1200, 500), (360, 480), (50, 40)])
def test_pixels_of_the_view_are_means_over_their_areas(size):
    width, height = size
    photo = photos.Photo(scene(width, height), width, height, 1, None)
    view = network_view(photo, (4 / 3,), 48, 36)
    columns = view.left + (np.arange(48) + 0.5) / 48 * view.width
    rows = view.top + (np.arange(36) + 0.5) / 36 * view.height
    np.testing.assert_allclose(view.image[..., 0].mean(0), 60 + 150 * (columns - 0.5) / (width - 1), atol=2)
    np.testing.assert_allclose(view.image[..., 1].mean(1), 40 + 180 * (rows - 0.5) / (height - 1), atol=2)


def test_fine_patterns_are_averaged_and_not_sampled():
    checks = np.repeat(255 * (np.indices((360, 480)).sum(0) % 2)[..., None], 3, 2).astype(np.uint8)
    view = network_view(photos.Photo(checks, 480, 360, 1, None), (4 / 3,), 48, 36)
    assert set(np.unique(view.image)) <= {127, 128}


# -- straightening -----------------------------------------------------------------------------------------------------


def lopez(k1):
    return 0.019 * k1 + 0.805 * k1 * k1


def waves(x, y):
    return 128 + 60 * np.sin(x / 9) + 50 * np.cos(y / 7)


@pytest.mark.parametrize("keep", ["crop", "all"])
@pytest.mark.parametrize(("k1", "k2"), [(-0.3, lopez(-0.3)), (0.1, lopez(0.1)), (-0.1, 0.0), (0.0, 0.0)])
def test_a_distorted_picture_of_a_plane_is_made_straight(keep, k1, k2):
    width, height, focal = 240, 180, 150.0
    rows, columns = np.indices((height, width)) + 0.5
    u, v = (columns - width / 2) / focal, (rows - height / 2) / focal
    distorted = torch.from_numpy(np.hypot(u, v))
    radius = undistort_radius(distorted, torch.tensor(k1).double(), torch.tensor(k2).double())
    factor = (radius / distorted.clamp(min=1e-12)).numpy()
    image = np.repeat(waves(80 * u * factor, 80 * v * factor)[..., None], 3, 2).round().astype(np.uint8)
    straight, new = undistort_photo(image, focal, k1, k2, keep)
    expected = waves(80 * (columns - width / 2) / new, 80 * (rows - height / 2) / new)
    inside = straight[..., 0] > 5 if keep == "all" else np.ones((height, width), bool)
    inside[[0, -1]] = inside[:, [0, -1]] = False
    inner = cv2.erode(inside.astype(np.uint8), np.ones((7, 7))) > 0
    assert inner.mean() > 0.5
    assert np.abs(straight[..., 0] - expected)[inner].max() < 4


@pytest.mark.parametrize("k1", [-0.4, -0.1, -0.04, 0.15])
@pytest.mark.parametrize("size", [(160, 120), (90, 160), (200, 60)])
def test_crop_has_no_borders_and_is_the_largest_such_picture(k1, size):
    width, height = size
    white = np.full((height, width, 3), 255, np.uint8)
    focal = 0.6 * max(size)  # wide, but before any fold
    crop = straight_focal(width, height, focal, k1, lopez(k1), "crop")
    every = straight_focal(width, height, focal, k1, lopez(k1), "all")
    assert every < crop

    def border(straight):  # source coordinates of the picture's outline, in half sides
        t = np.linspace(-1, 1, 401)
        edge = np.concatenate([np.stack([t, 0 * t + 1], 1), np.stack([0 * t + 1, t], 1)]) * [width / 2, height / 2]
        r = np.hypot(*edge.T) / straight
        return np.abs(edge / straight * (focal * (1 + k1 * r**2 + lopez(k1) * r**4))[:, None] / [width / 2, height / 2])

    assert border(crop).max() <= 1 + 1e-6
    assert border(crop / 1.01).max() > 1  # a little wider and a corner is empty
    assert border(every).max(1).min() >= 1 - 1e-6  # everything is in
    assert border(every * 1.01).max(1).min() < 1
    image, new = undistort_photo(white, focal, k1, lopez(k1), "crop")
    assert new == crop
    assert (image == 255).all()


def test_beyond_the_fold_there_is_no_picture():
    white = np.full((120, 160, 3), 255, np.uint8)
    image, _ = undistort_photo(white, 60.0, -0.3, 0.0, "all")  # folds at r = 1.05, seen at 0.70 of 60 px
    assert image[60, 80].tolist() == [255] * 3
    assert (image[:4, :4] == 0).all()
    crop, _ = undistort_photo(white, 60.0, -0.3, 0.0, "crop")
    assert (crop == 255).all()


def test_without_distortion_the_picture_is_the_same():
    image, focal = undistort_photo(scene(), 77.0, 0.0, 0.0)
    assert focal == pytest.approx(77, rel=1e-12)
    np.testing.assert_array_equal(image, scene())


def test_it_agrees_with_opencvs_own_undistortion():
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(256, size=(180, 240, 3), dtype=np.uint8), (0, 0), 2)
    straight, new = undistort_photo(image, 200.0, -0.2, lopez(-0.2))
    centre = np.array([[1, 0, 119.5], [0, 1, 89.5], [0, 0, 1.0]])
    camera, target = centre * [[200.0, 1, 1], [1, 200.0, 1], [1, 1, 1]], centre * [[new, 1, 1], [1, new, 1], [1, 1, 1]]
    maps = cv2.initUndistortRectifyMap(
        camera, np.array([-0.2, lopez(-0.2), 0, 0]), None, target, (240, 180), cv2.CV_32FC1
    )
    theirs = cv2.remap(image, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    assert np.abs(straight.astype(int) - theirs).max() <= 2
