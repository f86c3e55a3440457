"""Frames of a video, one by one."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.image_files import picture_bytes
from sextant.errors import UserError

VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")
Size = tuple[int, int, int]


def is_video(path: Path) -> bool:
    """Whether a path is a file named as a video.

    >>> is_video(Path("no_such_file.mp4"))
    False
    """
    return path.suffix.lower() in VIDEOS and path.is_file()


@dataclass(frozen=True)
class Frame:
    """One image.

    Attributes:
        name: of its file, or its number in the video.
        image: bytes of the requested size; None if there is no image.
        problem: why there is no image.
    """

    name: str
    image: UInt8[ndarray, "h w c"] | None
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Video:
    """Every ``every``-th frame of a video."""

    path: Path
    every: int
    frames: int
    per_second: float

    @classmethod
    def open(cls, path: Path, every: int) -> Self:
        """Every ``every``-th frame of a file; without a rate in the file, it counts as 25 frames a second.

        Raises:
            UserError: it cannot be read as a video.
        """
        import cv2

        video = open_video(path)
        try:
            frames = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
            per_second = float(video.get(cv2.CAP_PROP_FPS))
        finally:
            video.release()
        if frames <= 0:
            raise UserError(
                f"input={path} cannot be read as a video ({path.stat().st_size:,} bytes)",
                "Extract its frames as photos, for example: ffmpeg -i video.mp4 frames/%06d.png",
            )
        return cls(path, every, frames, per_second if per_second > 0 else 25.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers of the frames."""
        return tuple(f"frame {number}" for number in range(0, self.frames, self.every))

    @property
    def times_s(self) -> Float64[ndarray, "n"]:
        """Seconds from the start."""
        return np.arange(0, self.frames, self.every) / self.per_second

    def __len__(self) -> int:
        return math.ceil(self.frames / self.every)

    def read(self, size: Size | None) -> Iterator[Frame]:
        """Yield the frames, stretched to a size or as they are; those that cannot be decoded are reported."""

        video = open_video(self.path)
        try:
            for number in range(self.frames):
                if not video.grab():
                    if number % self.every == 0:
                        yield Frame(f"frame {number}", None, "cannot be decoded")
                    continue
                if number % self.every:
                    continue
                fine, pixels = video.retrieve()
                if not fine:
                    yield Frame(f"frame {number}", None, "cannot be decoded")
                    continue
                picture = Image.fromarray(np.ascontiguousarray(pixels[..., ::-1]))
                yield Frame(f"frame {number}", picture_bytes(picture, *(size or (picture.height, picture.width, 3))))
        finally:
            video.release()


def open_video(path: Path) -> Any:
    """OpenCV's reader of a video, which prints nothing: what is wrong with the file is reported by the caller."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    import cv2

    ffmpeg = cv2.videoio_registry.hasBackend(cv2.CAP_FFMPEG)  # other readers of AVI print their warnings
    with silent_opencv():
        return cv2.VideoCapture(str(path), cv2.CAP_FFMPEG if ffmpeg else cv2.CAP_ANY)


@contextmanager
def silent_opencv() -> Iterator[None]:
    """Keep OpenCV from printing."""
    import cv2

    set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel  # of OpenCV 4, of OpenCV 5
    level = set_level(0)
    try:
        yield
    finally:
        set_level(level)
