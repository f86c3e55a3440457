"""The properties of a video, and whether it can be decoded."""

from dataclasses import dataclass
from pathlib import Path

from sextant.chapters.localization.data.frames import open_video


@dataclass(frozen=True)
class FoundVideo:
    """A video.

    Attributes:
        name: name of the file.
        frames: number of frames, as its header states.
        per_second: frames per second; 0 if the header does not state them.
        width, height: pixels.
    """

    name: str
    frames: int
    per_second: float
    width: int
    height: int


def found_video(path: Path, name: str) -> FoundVideo | str:
    """The video, or why it cannot be used; its first frame is decoded."""
    if not path.is_file():
        return "is a link to nothing"
    if path.stat().st_size == 0:
        return "is empty (0 bytes)"
    import cv2

    video = open_video(path)
    try:
        opened = video.isOpened()
        read, frame = video.read() if opened else (False, None)
        frames, per_second = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), float(video.get(cv2.CAP_PROP_FPS))
    finally:
        video.release()
    size = f"({path.stat().st_size:,} bytes)"
    if not opened:
        return f"cannot be opened as a video {size}"
    if not read or frame is None or frames <= 0:
        return f"does not decode: its first frame cannot be read {size}"
    height, width = frame.shape[:2]
    return FoundVideo(name, frames, max(per_second, 0.0), width, height)
