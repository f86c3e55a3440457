import contextlib
import math
import struct
import warnings
import zlib

import cv2
import numpy as np
import pytest
from data.photos.pictures import UPRIGHT, exif_with, save, scene
from PIL import Image

from sextant.data.photos import read_photo
from sextant.errors import UserError


@pytest.mark.parametrize("kind", ["png", "jpg", "tif", "webp"])
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_a_photo_has_the_size_of_its_upright_picture(tmp_path, kind, orientation):
    photo = read_photo(save(tmp_path / f"p.{kind}", scene(), exif=exif_with(orientation)))
    assert (photo.height, photo.width) == UPRIGHT[orientation](scene()).shape[:2] == photo.image.shape[:2]
    assert (photo.orientation, photo.scale) == (orientation, 1)


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_is_ignored(tmp_path, orientation):
    photo = read_photo(save(tmp_path / "p.png", scene(), exif=exif_with(orientation)))
    np.testing.assert_array_equal(photo.image, scene())


@pytest.mark.parametrize(("top", "white"), [(1.0, 1), (255.0, 255), (1023.0, 1023), (4000.0, 4095)])
def test_floating_point_is_scaled_to_bytes(tmp_path, top, white):
    values = np.linspace(0, top, 64 * 96, dtype=np.float32).reshape(64, 96)
    values[0, 0] = np.nan
    image = read_photo(save(tmp_path / "p.tif", values)).image
    assert np.abs(image[..., 0] - np.nan_to_num(values) * 255 / white).max() <= 0.51


def test_the_transparent_colour_of_a_palette_becomes_mid_grey(tmp_path):
    palette = Image.fromarray(scene()).quantize(16)
    colours, hidden = np.asarray(palette.convert("RGB")), np.asarray(palette) == 3
    image = read_photo(save(tmp_path / "p.png", palette, transparency=3)).image
    assert (image[hidden] == 128).all()
    np.testing.assert_array_equal(image[~hidden], colours[~hidden])


def test_of_several_pictures_the_first_is_read(tmp_path):
    first, second = Image.new("RGB", (40, 40), (0, 0, 0)), Image.new("RGB", (40, 40), (255, 255, 255))
    first.save(tmp_path / "a.gif", save_all=True, append_images=[second])
    assert (read_photo(tmp_path / "a.gif").image == 0).all()


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (b"not a picture", "it is text"), (b"%!PS-Adobe-3.0 EPSF-3.0\n", "is PostScript")],
)
def test_what_is_no_picture_is_named(tmp_path, content, says):
    (tmp_path / "p.jpg").write_bytes(content)
    with pytest.raises(UserError, match=says) as raised:
        read_photo(tmp_path / "p.jpg")
    assert "p.jpg" in raised.value.problem
    assert raised.value.fix


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path, says in ((tmp_path / "none.jpg", "does not exist"), (tmp_path, "is a folder; a photo is a file")):
        with pytest.raises(UserError, match=says):
            read_photo(path)


@pytest.mark.parametrize(
    ("name", "brand", "says"),
    [
        ("p.heic", b"heic", "p.heic is HEIC by its content, which is not decoded here: save it as JPEG"),
        ("v.mp4", b"mp42", "v.mp4 is a video, not a photo"),
    ],
)
def test_a_format_that_is_not_decoded_is_explained(tmp_path, name, brand, says):
    (tmp_path / name).write_bytes(b"\0\0\0\x18ftyp" + brand + bytes(100))
    with pytest.raises(UserError, match=says):
        read_photo(tmp_path / name)


@pytest.mark.parametrize("kind", ["jpg", "png", "tif", "webp", "gif", "bmp", "jp2"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
def test_a_truncated_photo_is_refused(tmp_path, kind, share):
    noise = np.random.default_rng(0).integers(256, size=(64, 96, 3), dtype=np.uint8)
    path = save(tmp_path / f"p.{kind}", noise)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(UserError, match=r"cannot be decoded|is empty|is a TIFF of a kind"):
        read_photo(path)


def test_a_jpeg_2000_that_was_cut_before_its_data_is_refused_though_its_decoder_gives_grey(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (32, 32, 4), np.uint8)
    Image.fromarray(noise).save(tmp_path / "whole.jp2")
    read_photo(tmp_path / "whole.jp2")
    content = (tmp_path / "whole.jp2").read_bytes()
    (tmp_path / "cut.jp2").write_bytes(content[: content.index(b"\xff\x90") + 2])
    with pytest.raises(UserError, match="cannot be decoded"):
        read_photo(tmp_path / "cut.jp2")


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
    monkeypatch.setattr("sextant.data.photos.reading.LARGEST_DECODED", limit)
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
