"""The frames of a video as photos of one camera."""

import glob
import math
from collections.abc import Iterator
from pathlib import Path

from sextant.applications.write_errors import telling_write_errors
from sextant.chapters.calibration.written_cameras import save_picture
from sextant.data.photo_files import FRAMES
from sextant.data.videos import Video

#: frames that are calibrated unless ``every`` says otherwise, evenly spaced
MOST = 30


def chosen_frames(path: Path, every: int | None = None) -> Video:
    """A video reduced to every n-th frame; by default, to at most :data:`MOST`.

    Raises:
        UserError: it cannot be read as a video.
    """
    return Video.open(path, every or max(1, math.ceil(Video.open(path, 1).frames / MOST)))


def write_frames(video: Video, output: Path) -> Iterator[tuple[Path, str]]:
    """Write frames as JPEG files named by their numbers into ``frames`` below ``output``, an existing folder.

    Frames of this video that were written there before are removed, and no other files.

    Yields:
        The file of each frame, and why it was not written; "" if it was.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    folder, stem = output / FRAMES, video.path.stem
    with telling_write_errors(output):
        folder.mkdir(exist_ok=True)
        for old in folder.glob(f"{glob.escape(stem)}_frame_{'[0-9]' * 6}.jpg"):
            old.unlink()
    for number, frame in zip(range(0, video.frames, video.every), video.read(None), strict=True):
        path = folder / f"{stem}_frame_{number:06d}.jpg"
        if frame.image is not None:
            with telling_write_errors(output):
                save_picture(frame.image, path)
        yield path, frame.problem
