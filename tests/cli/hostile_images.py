"""Files that are given as photos and are none, or hardly: made by hypothesis, with what may be said of them."""

import io
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from PIL import Image

#: format -> modes that Pillow writes in it
MODES = {
    "JPEG": ("L", "RGB", "CMYK", "YCbCr"),
    "PNG": ("1", "L", "LA", "P", "RGB", "RGBA", "I;16"),
    "TIFF": ("1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "I;16", "I", "F"),
    "BMP": ("1", "L", "P", "RGB"),
    "WEBP": ("RGB", "RGBA"),
    "PPM": ("1", "L", "RGB", "I;16"),
    "GIF": ("L", "P", "RGB"),
    "JPEG2000": ("L", "RGB", "RGBA"),
}
SUFFIX = {"JPEG": "jpg", "JPEG2000": "jp2", "TIFF": "tif"}
SUFFIXES = ("jpg", "JPEG", "png", "tif", "bmp", "webp", "ppm", "pgm", "gif", "jp2", "heic")
#: modes whose white is not known
UNKNOWN_WHITE = ("F",)
PAGES = ("GIF", "TIFF", "WEBP", "PNG")
DAMAGES = ("none", "none", "cut", "cut", "empty", "flipped", "huge", "header", "noise", "more", "other")
OTHERS = (
    b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 64 64\n%%EndComments\n(x) run\nshowpage\n",
    b'<svg xmlns="http://www.w3.org/2000/svg" width="64" height="64"/>',
    b"%PDF-1.7\n",
    b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00mif1heic",
    b"plain text",
)


@dataclass(frozen=True)
class HostileFile:
    """A file, and what is known of it.

    Attributes:
        name: of the file.
        content: its bytes; None for a folder of that name.
        whole: the undamaged bytes.
        damage: what was done to it.
        mode: of the picture.
        size: of the picture.
    """

    name: str
    content: bytes | None
    whole: bytes
    damage: str
    mode: str
    size: tuple[int, int]

    @property
    def is_photo(self) -> bool:
        """Whether it has to be read: a whole picture of a size and kind that any program shows."""
        return self.damage in ("none", "more") and min(self.size) >= 32 and self.mode not in UNKNOWN_WHITE

    @property
    def is_none(self) -> bool:
        """Whether it must not be read: its bytes are not those of a picture, or far fewer than its header says."""
        # an animated PNG may show its first frame in a part of the canvas
        return self.damage in ("empty", "other") or (self.damage == "huge" and b"acTL" not in self.whole)

    def write(self, folder: Path) -> Path:
        """Put it into a folder."""
        path = folder / self.name
        if self.content is None:
            path.mkdir()
        else:
            path.write_bytes(self.content)
        return path


def _picture(seed: int, size: tuple[int, int], mode: str) -> Image.Image:
    rng = np.random.default_rng(seed)
    width, height = size
    grey = 40 + 170 * np.linspace(0, 1, width) * np.ones((height, 1)) + rng.integers(0, 30, (height, width))
    if mode == "I;16":
        return Image.fromarray((grey * 200).astype(np.uint16))
    if mode in ("I", "F"):
        return Image.fromarray((grey * 200).astype(np.int32 if mode == "I" else np.float32))
    return Image.fromarray(grey.astype(np.uint8)).convert("RGB").convert(mode)


def _exif(kind: str, noise: bytes) -> bytes:
    block = Image.Exif()
    block[0x0112] = 6
    block.get_ifd(0x8769)[0xA405] = 28
    if kind == "odd":  # an orientation in letters
        return b"Exif\x00\x00II*\x00\x08\x00\x00\x00" + struct.pack("<HHHI4sI", 1, 0x0112, 2, 4, b"up\x00\x00", 0)
    return block.tobytes()[:14] + noise if kind == "broken" else block.tobytes()


def _huge(content: bytes, side: int) -> bytes:
    """The same file, whose header tells of a much larger picture."""
    if content.startswith(b"\x89PNG"):
        header = content[12:16] + struct.pack(">II", side, side) + content[24:29]
        return content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:]
    if content.startswith(b"BM"):
        return content[:18] + struct.pack("<ii", side, side) + content[26:]
    if content.startswith(b"GIF"):
        return content[:6] + struct.pack("<HH", 65535, 65535) + content[10:]
    if content.startswith(b"P6"):
        return b"P6\n%d %d\n255\n" % (side, side) + content[-20:]
    at = content.find(b"\xff\xc0") if content.startswith(b"\xff\xd8") else 0
    return content[: at + 5] + struct.pack(">HH", 65500, 65500) + content[at + 9 :] if at > 0 else b""


@st.composite
def hostile_files(draw: st.DrawFn) -> HostileFile:
    """One file."""
    kind = draw(st.sampled_from(sorted(MODES)))
    mode = draw(st.sampled_from(MODES[kind]))
    side = st.one_of(st.integers(32, 80), st.integers(1, 40))
    size = (draw(side), draw(side))
    pictures = [_picture(draw(st.integers(0, 99)), size, mode)]
    options: dict[str, object] = {}
    if kind in PAGES and draw(st.booleans()) and mode not in ("I;16", "I", "F"):
        pictures.append(_picture(7, size, mode))
        options = {"save_all": True, "append_images": pictures[1:]}
    if kind in ("JPEG", "PNG", "WEBP", "TIFF"):
        about = draw(st.sampled_from(("none", "turned", "odd", "broken")))
        if about != "none":
            options["exif"] = _exif(about, draw(st.binary(max_size=24)))
    buffer = io.BytesIO()
    try:
        pictures[0].save(buffer, kind, **options)
    except Exception:  # Pillow writes no such block
        buffer = io.BytesIO()
        pictures[0].save(buffer, kind)
    whole = buffer.getvalue()
    damage = draw(st.sampled_from(DAMAGES))
    content = _damaged(draw, whole, damage)
    own = SUFFIX.get(kind, kind.lower())
    suffix = draw(st.one_of(st.just(own), st.sampled_from(SUFFIXES)))
    stem = draw(st.sampled_from(("a", "photo 1", "[red]x[b]", "é$\\frac", "x" * 60)))
    if draw(st.integers(0, 19)) == 0:
        return HostileFile(f"{stem}.{suffix}", None, whole, "folder", mode, size)
    return HostileFile(f"{stem}.{suffix}", content, whole, damage, mode, size)


def _damaged(draw: st.DrawFn, whole: bytes, damage: str) -> bytes:
    if damage == "cut":
        return whole[: draw(st.integers(1, len(whole) - 1))]
    if damage == "empty":
        return b""
    if damage == "header":
        return whole[: draw(st.integers(1, min(40, len(whole) - 1)))]
    if damage == "flipped":
        changed = bytearray(whole)
        for _ in range(draw(st.integers(1, 20))):
            changed[draw(st.integers(0, len(whole) - 1))] ^= draw(st.integers(1, 255))
        return bytes(changed)
    if damage == "huge":
        return _huge(whole, draw(st.sampled_from((5_000, 70_000, 2_000_000_000))))
    if damage == "noise":
        return draw(st.binary(min_size=1, max_size=200))
    if damage == "more":
        return whole + b"\x00" * draw(st.integers(1, 200))
    return draw(st.sampled_from(OTHERS)) if damage == "other" else whole
