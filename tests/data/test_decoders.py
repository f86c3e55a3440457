"""What every reader of image files makes of the same file: upright, 8 bits, RGB or grey, without transparency."""

import numpy as np
import pytest
from data.photos.pictures import UPRIGHT, exif_with, save, scene
from PIL import Image

from sextant.chapters.calibration.data.panorama_folder import decode_panorama
from sextant.data.image_files import decode_image
from sextant.data.image_folder import decode_square
from sextant.data.photos import read_photo

WIDTH, HEIGHT = 128, 64
READERS = {
    "photo": lambda path: read_photo(path).image,
    "square": lambda path: decode_square(path, HEIGHT, 3),
    "grey square": lambda path: decode_square(path, HEIGHT, 1),
    "image": lambda path: decode_image(path, HEIGHT, WIDTH, 3),
    "grey image": lambda path: decode_image(path, HEIGHT, WIDTH, 1)[..., 0],
    "panorama": lambda path: decode_panorama(path, HEIGHT),
}
#: readers that do not make grey of colours, which rounds
EXACT = ("photo", "square", "image", "panorama")
OPTIONS = {"webp": {"lossless": True}, "jpg": {"quality": 100, "subsampling": 0}}


def expected(reader, rgb):
    """What a reader makes of an upright picture."""
    rgb = rgb[:, (WIDTH - HEIGHT) // 2 : (WIDTH + HEIGHT) // 2] if "square" in reader else rgb
    return rgb @ [0.299, 0.587, 0.114] if "grey" in reader else rgb


def errors(reader, path, rgb):
    """How far what a reader makes of a file is from an upright picture, in levels of a byte."""
    found, right = READERS[reader](path), expected(reader, rgb)
    assert found.dtype == np.uint8
    assert found.shape == right.shape
    return np.abs(found - right.astype(float))


def stored(orientation, scale=1):
    """A picture as a camera stores it that holds it so."""
    width, height = (WIDTH, HEIGHT) if orientation < 5 else (HEIGHT, WIDTH)
    return scene(scale * width, scale * height)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["png", "jpg", "tif", "webp"])
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_what_was_stored_turned_is_read_upright(tmp_path, reader, kind, orientation):
    pixels = stored(orientation)
    path = save(tmp_path / f"p.{kind}", pixels, exif=exif_with(orientation), **OPTIONS.get(kind, {}))
    limit = 4 if kind == "jpg" else 0 if reader in EXACT else 1
    assert errors(reader, path, UPRIGHT[orientation](pixels)).max() <= limit


@pytest.mark.parametrize("reader", [name for name in READERS if name != "photo"])
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_a_large_jpeg_is_turned_and_scaled(tmp_path, reader, orientation):
    path = save(tmp_path / "p.jpg", stored(orientation, scale=8), exif=exif_with(orientation), quality=95)
    assert errors(reader, path, UPRIGHT[orientation](stored(orientation))).mean() < 3


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("mode", ["RGB", "L", "LA", "RGBA", "P", "1", "CMYK"])
def test_every_kind_of_pixel_is_read(tmp_path, reader, mode):
    image = Image.fromarray(scene(WIDTH, HEIGHT)).convert(mode)
    path = save(tmp_path / ("p.tif" if mode == "CMYK" else "p.png"), image)
    assert errors(reader, path, np.asarray(image.convert("RGB"))).max() <= (0 if reader in EXACT else 1)
    if mode == "CMYK":
        assert errors(reader, save(tmp_path / "p.jpg", image, **OPTIONS["jpg"]), scene(WIDTH, HEIGHT)).max() <= 4


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["png", "tif"])
def test_sixteen_bits_keep_their_eight_most_significant(tmp_path, reader, kind):
    deep = np.random.default_rng(0).integers(1 << 16, size=(HEIGHT, WIDTH)).astype(np.uint16)
    grey = np.repeat((deep >> 8)[..., None], 3, 2)
    assert errors(reader, save(tmp_path / f"p.{kind}", deep), grey).max() < 0.01


@pytest.mark.parametrize(("reader", "background"), [(name, 128 if name == "photo" else 0) for name in READERS])
@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_what_is_transparent_shows_the_readers_background(tmp_path, reader, background, mode):
    pixels = scene(WIDTH, HEIGHT, channels=4)
    pixels[:20, :, 3], pixels[20:40, :, 3] = 0, 128
    image = Image.fromarray(pixels).convert(mode)
    share = pixels[..., 3:] / 255
    shown = share * np.asarray(image.convert("RGB")) + (1 - share) * background
    wrong = errors(reader, save(tmp_path / "p.png", image), shown)
    assert wrong.max() <= 1.1
    assert wrong[:20].max() < 0.01
