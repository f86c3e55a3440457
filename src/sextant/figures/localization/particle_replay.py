"""Animations of a filter: the particles over the map, frame by frame."""

import io
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

from sextant.errors import UserError
from sextant.figures.localization.particle_map import ParticleFrame
from sextant.figures.localization.particle_view import ParticleView


class _Writer(Protocol):
    def write(self, image: UInt8[ndarray, "h w 3"]) -> None: ...

    def close(self) -> None: ...


def particle_replay(
    map_positions: Float[ndarray, "n 2"],
    frames: Iterable[ParticleFrame],
    path: Path,
    *,
    frames_per_second: float = 10.0,
    width: float = 6.0,
    unit: str = "m",
    seen: bool = False,
    walls: Float[ndarray, "w 2"] | None = None,
) -> int:
    """Write a video (``.mp4``) or an animation that any browser shows (``.gif``), and return the number of frames.

    Frames are drawn and written as they come, so memory does not grow with their number if they come from a generator.
    The file appears when it is complete.

    Args:
        map_positions: positions of the map's images.
        frames: the moments, in order.
        path: path of the file to write; its folder is created.
        frames_per_second: speed of the animation.
        width: width of the map in inches of 100 pixels.
        unit: unit of positions.
        seen: show the frames' images beside the map.
        walls: points on walls, if they are known.

    Raises:
        UserError: the path has another suffix, there is no frame, or no MP4 can be written on this machine.
        ValueError: the map has no position.

    Example:
        >>> import tempfile
        >>> corridor = np.column_stack([np.arange(9.0), np.zeros(9)])
        >>> frames = [ParticleFrame(np.array([[float(x), 0, 0]]), np.zeros(1)) for x in range(2)]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     particle_replay(corridor, frames, Path(folder, "replay.gif"), width=2.0)
        2
    """
    if path.suffix not in (".gif", ".mp4"):
        raise UserError(f"{path}: a replay is written as .gif or .mp4", f"Try {path.with_suffix('.gif')}")
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.stem}.unfinished{path.suffix}")
    view: ParticleView | None = None
    writer: _Writer | None = None
    count = 0
    try:
        for frame in frames:
            if view is None:
                view = ParticleView(map_positions, width=width, unit=unit, seen=seen, walls=walls)
            image = view.draw(frame)
            if writer is None:
                writer = (_Gif if path.suffix == ".gif" else _Mp4)(unfinished, frames_per_second, image.shape)
            writer.write(image)
            count += 1
        if writer is None:
            raise UserError("a replay needs at least one frame", "Run the filter for longer")
        writer.close()
        writer = None
        unfinished.replace(path)
    finally:
        if writer is not None:
            writer.close()
        unfinished.unlink(missing_ok=True)
    return count


class _Gif:
    """Appends each image to the file at once, with its own colour table.

    An animation is a header, a block that asks for repetition, and images one after the other. Pillow writes each image
    as a separate GIF, whose global colour table becomes a local one here. (The animations of matplotlib and Pillow hold
    all frames until the end.) Format: CompuServe, "Graphics Interchange Format, version 89a", 1990.
    """

    def __init__(self, path: Path, frames_per_second: float, shape: tuple[int, ...]):
        self._centiseconds = max(2, round(100 / frames_per_second))  # browsers slow down faster animations
        self._file = path.open("wb")
        height, width = shape[:2]
        self._file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0, 0, 0))
        self._file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01" + struct.pack("<HB", 0, 0))

    def write(self, image: UInt8[ndarray, "h w 3"]) -> None:
        whole = io.BytesIO()
        picture = Image.fromarray(image).quantize(128, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        picture.save(whole, "GIF", interlace=0)
        data = whole.getvalue()
        size = data[10] & 7  # the table has 2^(size + 1) colours
        colours = data[13 : 13 + 3 * 2 ** (size + 1)]
        at = 13 + len(colours)
        while data[at] == 0x21:  # extensions: a label, then blocks up to an empty one
            at += 2
            while data[at]:
                at += data[at] + 1
            at += 1
        placed, pixels = data[at : at + 9], data[at + 10 : -1]  # without the flags, and without the file's end
        self._file.write(b"\x21\xf9\x04" + struct.pack("<BHBB", 4, self._centiseconds, 0, 0))
        self._file.write(placed + bytes([0x80 | size]) + colours + pixels)

    def close(self) -> None:
        self._file.write(b"\x3b")
        self._file.close()


class _Mp4:
    def __init__(self, path: Path, frames_per_second: float, shape: tuple[int, ...]):
        import cv2

        codec = cv2.VideoWriter.fourcc(*"mp4v")
        self._video = cv2.VideoWriter(str(path), codec, frames_per_second, (shape[1], shape[0]))
        if not self._video.isOpened():
            raise UserError(f"{path}: OpenCV cannot write MP4 on this machine", f"Try {path.with_suffix('.gif')}")

    def write(self, image: UInt8[ndarray, "h w 3"]) -> None:
        self._video.write(np.ascontiguousarray(image[..., ::-1]))

    def close(self) -> None:
        self._video.release()
