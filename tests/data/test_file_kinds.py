"""Files given as pictures that are none, or none that is decoded, under any name; and PNGs with odd chunks.

The boundaries of the kind: raw files by suffix, by signature, by the tags of a TIFF (a preview first, or not); other
contents called .jpg; pictures under another picture's name, which are read; chunks that are broken, large, packed or
behind the pixels.
"""

import io
import struct
import zlib

import numpy as np
import pytest
import tifffile
from data.photos.pictures import save, scene
from PIL import Image

from sextant.data.file_kinds import RAW
from sextant.data.image_files import decode_image
from sextant.data.image_folder import decode_square
from sextant.data.photo_files import find_photos, images_below
from sextant.data.photos import read_photo
from sextant.data.photos.header import read_header
from sextant.data.picture_files import UnreadableImageError
from sextant.errors import UserError

READERS = {
    "photos": read_photo,
    "headers": read_header,
    "places and drives": lambda path: decode_image(path, 32, 32, 3),
    "classes": lambda path: decode_square(path, 32, 3),
}


def why_refused(path):
    """The reason that all readers give; one line."""
    said = set()
    for read in READERS.values():
        with pytest.raises((UserError, UnreadableImageError)) as raised:
            read(path)
        problem = getattr(raised.value, "problem", str(raised.value))
        said.add(problem.removeprefix(f"{path} "))
    (reason,) = said
    assert "\n" not in reason
    return reason


def tiff(path, tags=(), pages=1):
    with tifffile.TiffWriter(path) as file:
        for page in range(pages):
            file.write(scene(), photometric="rgb", metadata=None, extratags=[*tags] if page == 0 else ())
    return path


def preview_first(path, order="<", old=False):
    """A TIFF whose first directory is marked as the smaller version of another picture."""
    content = io.BytesIO()
    with tifffile.TiffWriter(content, byteorder=order) as file:
        file.write(scene(48, 32), photometric="rgb", subfiletype=0 if old else 1, metadata=None,
                   extratags=[(255, "H", 1, 2, True)] if old else ())  # fmt: skip
        file.write(scene(), photometric="rgb", metadata=None)
    path.write_bytes(content.getvalue())
    return path


@pytest.mark.parametrize("suffix", [*RAW, ".DNG", ".Nef"])
def test_raw_files_are_refused_by_their_suffix(tmp_path, suffix):
    path = preview_first(tmp_path / f"p{suffix}")
    reason = why_refused(path)
    assert reason.startswith(f"is a raw file ({suffix.lower()})")
    assert "darktable" in reason
    other = tmp_path / f"other{suffix}"
    other.write_bytes(bytes(range(256)) * 8)
    assert why_refused(other).startswith("is a raw file")


@pytest.mark.parametrize("name", ["p.tif", "p.tiff", "p.jpg", "p"])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("old", [False, True])
def test_a_preview_is_refused_by_its_tags(tmp_path, name, order, old):
    assert "NewSubfileType 1" in why_refused(preview_first(tmp_path / name, order, old))


def test_a_dng_is_refused_by_its_version(tmp_path):
    assert "raw file (DNG by its tags)" in why_refused(tiff(tmp_path / "p.tif", [(0xC612, "B", 4, (1, 4, 0, 0), True)]))


@pytest.mark.parametrize("tags", [[], [(254, "I", 1, 0, True)], [(254, "I", 1, 2, True)], [(255, "H", 1, 1, True)]])
@pytest.mark.parametrize("pages", [1, 3])
def test_a_tiff_whose_first_page_is_whole_is_read(tmp_path, tags, pages):
    path = tiff(tmp_path / "p.tif", tags, pages)
    np.testing.assert_array_equal(read_photo(path).image, scene())
    assert read_header(path).width == 96
    assert decode_image(path, 32, 32, 3).any()


CONTENTS = {
    "heic": (b"\0\0\0\x18ftypheic", "is HEIC by its content"), "heix": (b"\0\0\0\x18ftypheix", "is HEIC"),
    "mif1": (b"\0\0\0\x18ftypmif1", "is HEIC"), "hevc": (b"\0\0\0\x18ftyphevc", "is HEIC"),
    "msf1": (b"\0\0\0\x18ftypmsf1", "is HEIC"), "cr3": (b"\0\0\0\x18ftypcrx ", "is a raw file"),
    "raf": (b"FUJIFILMCCD-RAW 0201", "is a raw file"), "cr2": (b"II*\0\x10\0\0\0CR\2\0", "is a raw file"),
    "orf": (b"IIRO\x08\0\0\0", "is a raw file"), "rw2": (b"IIU\0\x18\0\0\0", "is a raw file"),
    "x3f": (b"FOVb\0\0\2\0", "is a raw file"), "mrw": (b"\0MRM\0\0\0\0", "is a raw file"),
    "mp4": (b"\0\0\0\x18ftypmp42", "is a video"), "mov": (b"\0\0\0\x14ftypqt  ", "is a video"),
    "old mov": (b"\0\0\0\x08wide\0\0\0\0mdat", "is a video"), "avi": (b"RIFF\x10\0\0\0AVI LIST", "is a video"),
    "webm": (b"\x1aE\xdf\xa3\x01\0\0", "is a video"), "pdf": (b"%PDF-1.7\n%\xe2\xe3", "is a PDF document"),
    "html": (b"<!DOCTYPE html>\n<html>", "is an HTML page"),
    "html in capitals": (b"\n <HTML><HEAD>", "is an HTML page"),
    "xml": (b"<?xml version='1.0'?><Error>", "is XML"), "svg": (b"<?xml version='1.0'?>\n<svg xmlns=", "is an SVG"),
    "psd": (b"8BPS\0\1", "is a Photoshop document"), "jxl": (b"\xff\x0a\xfa\x1f", "is JPEG XL"),
    "jxl in a box": (b"\0\0\0\x0cJXL \r\n\x87\n", "is JPEG XL"), "eps": (b"%!PS-Adobe-3.0 EPSF-3.0", "is PostScript"),
    "exr": (b"v/1\x01\2\0\0\0", "is a picture of high"), "zip": (b"PK\x03\x04\x14\0", "is an archive"),
    "gzip": (b"\x1f\x8b\x08\0", "is an archive"), "npy": (b"\x93NUMPY\1\0", "is a file of arrays"),
    "lfs": (b"version https://git-lfs.github.com/spec/v1\n", "is a pointer of Git LFS"),
    "text": (b"file,x,y\na.png,1,2\n", "it is text"), "zeros": (bytes(600), "holds zeros"),
    "noise": (bytes(range(1, 200)), "it is not a picture in a known format"),
}  # fmt: skip


@pytest.mark.parametrize("name", CONTENTS)
def test_other_contents_are_named_under_a_pictures_name(tmp_path, name):
    content, says = CONTENTS[name]
    path = tmp_path / "IMG_0001.jpg"
    path.write_bytes(content + (b"" if name in ("text", "lfs", "zeros", "noise") else bytes(range(1, 100))))
    assert says in why_refused(path)


def test_nothing_and_what_is_no_file(tmp_path):
    (tmp_path / "p.jpg").touch()
    assert why_refused(tmp_path / "p.jpg") in ("is empty (0 bytes)", "is empty")


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF", "GIF", "BMP", "AVIF", "PPM"])
@pytest.mark.parametrize("name", ["p.jpg", "p.png", "p.tif", "p.heic", "p.gif", "p"])
def test_a_picture_is_read_under_the_name_of_another_kind(tmp_path, kind, name):
    Image.fromarray(scene()).save(tmp_path / name, format=kind)
    for read in READERS.values():
        read(tmp_path / name)
    assert np.abs(read_photo(tmp_path / name).image.astype(int) - scene()).mean() < 8


def test_raw_files_beside_photos_are_left_out_and_named(tmp_path, caplog):
    for i in range(3):
        save(tmp_path / f"IMG_{i}.jpg", scene())
        preview_first(tmp_path / f"IMG_{i}.NEF")
    assert [path.name for path in find_photos(str(tmp_path), None)] == ["IMG_0.jpg", "IMG_1.jpg", "IMG_2.jpg"]
    (said,) = caplog.messages
    assert "left out 3 raw files, such as IMG_0.NEF" in said
    assert "darktable" in said
    for path in tmp_path.glob("*.jpg"):
        path.unlink()
    with pytest.raises(UserError, match=r"no photo there, but 3 raw files, such as IMG_0\.NEF: develop"):
        find_photos(str(tmp_path), None)


def test_photos_without_suffixes_are_left_out_and_named(tmp_path, caplog):
    save(tmp_path / "seen.jpg", scene())
    for name, kind in (("IMG_1", "JPEG"), ("IMG_2", "PNG"), ("IMG_3", "WEBP")):
        Image.fromarray(scene()).save(tmp_path / name, format=kind)
    (tmp_path / "README").write_text("RIFF and other words")
    assert [path.name for path in find_photos(str(tmp_path), None)] == ["seen.jpg"]
    (said,) = caplog.messages
    assert said.endswith("left out 3 files, such as IMG_1, by its content a photo, whose name has no suffix: add .jpg "
                         "or another suffix")  # fmt: skip
    assert [path.name for path in images_below(tmp_path)] == ["seen.jpg"]
    assert "3 files left out, such as IMG_1, by its content a photo" in caplog.messages[-1]
    (tmp_path / "seen.jpg").unlink()
    with pytest.raises(
        UserError, match=r"but 3 files, such as IMG_1, by its content a photo, whose name has no suffix: add \.jpg"
    ):
        find_photos(str(tmp_path), None)


# -- PNG: chunks without pixels never refuse a picture -----------------------------------------------------------------

LARGE = b"x" * 3_000_000


def chunk(kind, data, check=None):
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body) if check is None else check)


CHUNKS = {
    "large profile": chunk(b"iCCP", b"icc\0\0" + zlib.compress(LARGE)),
    "large packed text": chunk(b"zTXt", b"Comment\0\0" + zlib.compress(LARGE)),
    "large packed international text": chunk(b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(LARGE)),
    "large international text": chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + LARGE),
    "large text": chunk(b"tEXt", b"Comment\0" + LARGE),
    "huge profile": chunk(b"iCCP", b"icc\0\0" + zlib.compress(bytes(200_000_000), 1)),
    "broken profile": chunk(b"iCCP", b"icc\0\0not packed"),
    "cut profile": chunk(b"iCCP", b"icc\0\0" + zlib.compress(LARGE)[:-100]),
    "unknown packing": chunk(b"iCCP", b"icc\0\7" + zlib.compress(b"x")),
    "empty profile": chunk(b"iCCP", b""),
    "empty text": chunk(b"zTXt", b""),
    "garbage in exif": chunk(b"eXIf", b"garbage!"),
    "zeros in exif": chunk(b"eXIf", bytes(64)),
    "empty exif": chunk(b"eXIf", b""),
    "exif of 3 bytes": chunk(b"eXIf", b"MM\0"),
    "raw profile of exif": chunk(b"tEXt", b"Raw profile type exif\0\nexif\n      8\nnonsense\n"),
    "wrong sum of a text": chunk(b"tEXt", b"Comment\0hello", 7),
    "wrong sum of exif": chunk(b"eXIf", b"MM\0*\0\0\0\x08\0\0", 7),
    "short gamma": chunk(b"gAMA", b"\0", None),
    "short resolution": chunk(b"pHYs", b"\0\0"),
    "short time": chunk(b"tIME", b"\0"),
    "short suggestion": chunk(b"sRGB", b""),
    "short chroma": chunk(b"cHRM", b"\0\0\0\1"),
    "unknown chunk": chunk(b"abCd", b"1234"),
}


@pytest.mark.parametrize("where", ["before", "after"])
@pytest.mark.parametrize("name", CHUNKS)
def test_a_png_with_an_odd_chunk_is_read(tmp_path, name, where):
    content = save(tmp_path / "p.png", scene()).read_bytes()
    at = 33 if where == "before" else len(content) - 12  # after the header, or before the end
    (tmp_path / "p.png").write_bytes(content[:at] + CHUNKS[name] + content[at:])
    np.testing.assert_array_equal(read_photo(tmp_path / "p.png").image, scene())
    np.testing.assert_array_equal(decode_image(tmp_path / "p.png", 64, 96, 3), scene())
    assert (read_header(tmp_path / "p.png").width, read_header(tmp_path / "p.png").gps) == (96, (None, ""))
    assert decode_square(tmp_path / "p.png", 32, 3).any()


def test_a_chunk_that_holds_pixels_is_not_passed_over(tmp_path):
    noise = np.random.default_rng(0).integers(256, size=(64, 96, 3), dtype=np.uint8)
    content = bytearray(save(tmp_path / "p.png", noise).read_bytes())
    content[content.index(b"IDAT") + 4] ^= 255  # the header of the packed pixels
    (tmp_path / "p.png").write_bytes(content)
    with pytest.raises(UserError, match="cannot be decoded"):
        read_photo(tmp_path / "p.png")


@pytest.mark.parametrize("data", [b"garbage!", bytes(64), b"", b"Exif\0\0", b"MM\0*\xff\xff\xff\xff"])
def test_a_webp_with_a_broken_exif_chunk_is_read(tmp_path, data):
    buffer = io.BytesIO()
    Image.fromarray(scene()).save(buffer, "WEBP", lossless=True, exif=b"Exif\0\0MM\0*\0\0\0\x08\0\0")
    content = buffer.getvalue()
    at = content.index(b"EXIF")
    body = content[12:at] + b"EXIF" + struct.pack("<I", len(data)) + data
    (tmp_path / "p.webp").write_bytes(b"RIFF" + struct.pack("<I", len(body) + 4) + b"WEBP" + body)
    np.testing.assert_array_equal(read_photo(tmp_path / "p.webp").image, scene())
    assert read_header(tmp_path / "p.webp").width == 96
