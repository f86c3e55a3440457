"""Pictures of more than 8 bits: the same bytes from every reader, and comparable within a folder.

The boundaries of the kind: 8, 10, 12, 14 and 16 bits in 16, and whole numbers of 32; floating point as shares, bytes,
counts, or neither; grey, colour, alpha; PNG, TIFF (either byte order, planes apart, white as zero) and PGM with its own
white; the dark, the black and the broken among the bright; one picture alone; 8 bits untouched.
"""

import cv2
import numpy as np
import pytest
import tifffile
from data.photos.pictures import save, scene
from data.test_file_kinds import READERS
from PIL import Image

from sextant.data.image_files import decode_image
from sextant.data.image_folder import ImageFolder
from sextant.data.photos import read_photo
from sextant.data.pixel_values import WhiteLevels, eight_bits, is_deep

HEIGHT, WIDTH = 64, 96


def ramp(top, dtype=np.uint16):
    values = np.linspace(0, top, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    return (values if np.dtype(dtype).kind == "f" else values.round()).astype(dtype)


def colour(top, dtype=np.uint16):
    return np.stack([ramp(top, dtype), ramp(top, dtype)[::-1], ramp(top // 2, dtype)], -1)


def write(path, values, **options):
    """PNG and PGM by OpenCV, TIFF by tifffile."""
    if path.suffix == ".tif":
        layout = {"photometric": "rgb"} if values.ndim == 3 else {}
        tifffile.imwrite(path, values, **layout | options)
    else:
        order = [2, 1, 0, *range(3, values.shape[-1])]
        assert cv2.imwrite(str(path), values[..., order] if values.ndim == 3 else values)
    return path


def read_by_all(path):
    """The bytes that all readers agree upon."""
    pixels = read_photo(path).image
    np.testing.assert_array_equal(decode_image(path, HEIGHT, WIDTH, 3), pixels)
    return pixels


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("shape", ["grey", "colour"])
@pytest.mark.parametrize("kind", ["png", "tif", "big-endian tif", "pnm"])
def test_the_bits_in_sixteen_are_found(tmp_path, kind, shape, bits):
    values = (ramp if shape == "grey" else colour)((1 << bits) - 1)
    suffix = {"big-endian tif": ".tif", "pnm": ".pgm" if shape == "grey" else ".ppm"}.get(kind, f".{kind}")
    options = {"byteorder": ">"} if kind == "big-endian tif" else {}
    pixels = read_by_all(write(tmp_path / f"p{suffix}", values, **options))
    expected = values >> (bits - 8)
    np.testing.assert_array_equal(pixels, expected if values.ndim == 3 else np.repeat(expected[..., None], 3, 2))


@pytest.mark.parametrize("options", [{"compression": "deflate"}, {"extratags": [(274, "H", 1, 6, True)]}])
def test_colour_tiffs_of_any_layout(tmp_path, options):
    values = colour(1023)
    path = write(tmp_path / "p.tif", values, **options)
    pixels = read_photo(path).image
    np.testing.assert_array_equal(pixels, (np.rot90(values, -1) if "extratags" in options else values) >> 2)
    np.testing.assert_array_equal(decode_image(path, *pixels.shape[:2], 3), pixels)


def test_planes_are_refused_since_the_decoders_would_mix_them(tmp_path):
    write(tmp_path / "p.tif", np.ascontiguousarray(colour(1023).transpose(2, 0, 1)), planarconfig="separate")
    for read in READERS.values():
        with pytest.raises(Exception, match="is a 16-bit TIFF with a plane for each colour"):
            read(tmp_path / "p.tif")


@pytest.mark.parametrize("turn", [1, 6])
def test_a_deep_png_is_turned_upright(tmp_path, turn):
    exif = Image.Exif()
    exif[0x0112] = turn
    for name, values in (("grey.png", ramp(1023)), ("colour.png", colour(1023))):
        path = write(tmp_path / name, values)
        content = path.read_bytes()
        with Image.open(save(tmp_path / "with.png", Image.new("L", (4, 4)), exif=exif)) as small:
            small.load()
        other = (tmp_path / "with.png").read_bytes()
        at = other.index(b"eXIf") - 4
        piece = other[at : at + 12 + int.from_bytes(other[at : at + 4], "big")]
        path.write_bytes(content[:33] + piece + content[33:])
        pixels = read_photo(path).image
        assert pixels.shape[:2] == ((WIDTH, HEIGHT) if turn == 6 else (HEIGHT, WIDTH))
        expected = (values if values.ndim == 3 else np.repeat(values[..., None], 3, 2)) >> 2
        np.testing.assert_array_equal(pixels, np.rot90(expected, -1) if turn == 6 else expected)


@pytest.mark.parametrize(
    ("dtype", "top", "shift"),
    [(np.int32, 1023, 2), (np.int32, 65535, 8), (np.int32, 2**24 - 1, 16), (np.int32, 2**31 - 1, 24),
     (np.uint32, 2**32 - 1, 24), (np.uint32, 4095, 4), (np.int16, 1023, 2)],
)  # fmt: skip
def test_whole_numbers_of_other_sizes(tmp_path, dtype, top, shift):
    values = ramp(top, dtype)
    np.testing.assert_array_equal(read_by_all(write(tmp_path / "p.tif", values))[..., 0], values >> shift)


def test_what_is_negative_is_black(tmp_path):
    values = ramp(1023, np.int32)
    values[0] = -5
    assert (read_by_all(write(tmp_path / "p.tif", values))[0] == 0).all()


@pytest.mark.parametrize("dtype", [np.float32, ">f4"])
@pytest.mark.parametrize(("top", "white"), [(0.2, 1), (1.0, 1), (1.2, 1), (20.0, 255), (255.0, 255), (1000.0, 1023)])
def test_floating_point(tmp_path, dtype, top, white):
    values = ramp(top, dtype)
    values[0, :4] = [np.nan, np.inf, -np.inf, -1]
    pixels = read_by_all(write(tmp_path / "p.tif", values))
    expected = np.nan_to_num(values, nan=0, posinf=white, neginf=0).clip(0, white) * (255 / white)
    assert np.abs(pixels[..., 0] - expected).max() <= 0.51


@pytest.mark.parametrize("top", [2.0, 3.2, 15.9])
def test_floating_point_without_a_white_level_is_refused(tmp_path, top):
    path = write(tmp_path / "p.tif", ramp(top, np.float32))
    for name in ("photos", "places and drives", "classes"):
        with pytest.raises(Exception, match="white level is unknown: scale them") as raised:
            READERS[name](path)
        assert "\n" not in getattr(raised.value, "problem", str(raised.value))


@pytest.mark.parametrize("values", [np.zeros((HEIGHT, WIDTH, 3), np.float32), np.zeros((HEIGHT, WIDTH), np.float64),
                                    np.zeros((HEIGHT, WIDTH), np.float16), np.zeros((HEIGHT, WIDTH, 3), np.uint32),
                                    np.zeros((HEIGHT, WIDTH), np.uint64)])  # fmt: skip
def test_tiffs_that_pillow_does_not_know_are_refused(tmp_path, values):
    path = write(tmp_path / "p.tif", values)
    for read in READERS.values():
        with pytest.raises(Exception, match="is a TIFF of a kind that is not read here: save it with 8 or 16 bits"):
            read(path)


def test_alpha_has_its_own_bits(tmp_path):
    values = np.dstack([colour(1023), np.full((HEIGHT, WIDTH), 1023, np.uint16)])
    values[:10, :, 3] = 0
    path = write(tmp_path / "p.png", values)
    np.testing.assert_array_equal(read_photo(path).image[10:], values[10:, :, :3] >> 2)
    np.testing.assert_array_equal(decode_image(path, HEIGHT, WIDTH, 3)[10:], values[10:, :, :3] >> 2)
    assert (read_photo(path).image[:10] == 128).all()
    assert (decode_image(path, HEIGHT, WIDTH, 3)[:10] == 0).all()


def test_white_as_zero(tmp_path):
    values = ramp(65535)
    pixels = read_by_all(write(tmp_path / "p.tif", values, photometric="miniswhite"))
    np.testing.assert_array_equal(pixels[..., 0], 255 - (values >> 8))


@pytest.mark.parametrize("white", [1023, 4095, 40000])
@pytest.mark.parametrize("magic", ["P5", "P6"])
def test_a_pgm_that_states_its_white_is_not_stretched(tmp_path, magic, white):
    values = (ramp if magic == "P5" else colour)(white // 4)  # a dark one
    (tmp_path / "p.ppm").write_bytes(f"{magic} {WIDTH} {HEIGHT} {white}\n".encode() + values.astype(">u2").tobytes())
    pixels = read_by_all(tmp_path / "p.ppm")
    assert np.abs(pixels.max() - 255 / 4).max() <= 1


# -- a folder ----------------------------------------------------------------------------------------------------------


def folder(path, tops):
    path.mkdir(exist_ok=True)
    return [write(path / f"{i:03}.png", ramp(top)) for i, top in enumerate(tops)]


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_a_picture_of_the_night_stays_darker_than_one_of_the_day(tmp_path, bits):
    full = (1 << bits) - 1
    tops = [full // 30, full // 5, full, full // 100, 0]
    for path, top in zip(folder(tmp_path, tops), tops, strict=True):
        np.testing.assert_array_equal(read_by_all(path)[..., 0], ramp(top) >> (bits - 8))


def test_the_level_is_logged_once_and_sixteen_bits_are_not_worth_it(tmp_path, caplog):
    paths = [*folder(tmp_path / "ten", [1000] * 5), *folder(tmp_path / "sixteen", [65535, 900])]
    for path in paths:
        read_photo(path)
    for path in paths:  # by another reader
        decode_image(path, 64, 96, 3, WhiteLevels(paths))
    (said,) = caplog.messages
    level = "go up to 1000: white is taken as 1023 (10 bits)"
    assert said == f"{tmp_path}/ten: uint16 values of pictures of 96x64 pixels {level}"


def test_pictures_of_another_camera_have_their_own_level(tmp_path):
    ten, sixteen = write(tmp_path / "a.png", ramp(1023)), write(tmp_path / "b.png", ramp(65535)[:, :80])
    write(tmp_path / "c.tif", ramp(65535))
    (tmp_path / "d.png").write_bytes(b"broken")
    save(tmp_path / "e.png", scene())
    np.testing.assert_array_equal(read_photo(ten).image[..., 0], ramp(1023) >> 2)
    np.testing.assert_array_equal(read_photo(sixteen).image[..., 0], ramp(65535)[:, :80] >> 8)


def test_pictures_given_together_have_one_level(tmp_path):
    """Two classes, or traverses by day and by night, in a folder each."""
    day, night = folder(tmp_path / "day", [1023, 1000]), folder(tmp_path / "night", [100, 60])
    levels = WhiteLevels([*day, *night])
    np.testing.assert_array_equal(decode_image(night[0], HEIGHT, WIDTH, 1, levels)[..., 0], ramp(100) >> 2)
    np.testing.assert_array_equal(read_photo(day[1], levels).image[..., 0], ramp(1000) >> 2)
    read = ImageFolder(str(tmp_path), size=64, channels=1, test_fraction=0.5)
    images = [read.read(split).images for split in ("train", "test")]
    assert all(each.max() > 8 * each[1].max() for each in images)  # the night is the second class


def test_of_many_pictures_a_sample_is_examined_and_none_is_clipped(tmp_path, monkeypatch):
    monkeypatch.setattr("sextant.data.pixel_values.SAMPLE", 2)
    paths = folder(tmp_path, [1000, 900, 4000, 950])
    for path, top in zip(paths, [1000, 900, 4000, 950], strict=True):
        assert decode_image(path, HEIGHT, WIDTH, 1).max() in {top >> 2, top >> 4}
    assert decode_image(paths[2], HEIGHT, WIDTH, 1).max() == 4000 >> 4


def test_a_stream_has_the_largest_level_so_far():
    levels = WhiteLevels([])
    seen = [eight_bits(Image.fromarray(ramp(top)), None, levels) for top in (200, 1000, 200)]
    assert [np.asarray(each).max() for each in seen] == [200, 250, 50]


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK"])
def test_pictures_of_eight_bits_are_untouched(tmp_path, mode):
    image = Image.fromarray(scene()).convert(mode)
    path = save(tmp_path / ("p.tif" if mode == "CMYK" else "p.png"), image)
    assert not is_deep(path)
    with Image.open(path) as opened:
        assert eight_bits(opened, path) is opened
    expected = np.asarray(image.convert("RGB"))
    np.testing.assert_array_equal(read_by_all(path), expected)
    for deep in (write(tmp_path / "d.png", ramp(1023)), write(tmp_path / "d.tif", colour(1023))):
        assert is_deep(deep)
