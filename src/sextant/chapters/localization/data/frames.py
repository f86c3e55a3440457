"""The images to localize, one by one: photos of a folder, or frames of a video."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.pose_times import check_rising, times_of_names
from sextant.data.image_files import decode_image, natural_key
from sextant.data.name_matching import match_names
from sextant.data.photo_files import find_photos, reason_alone
from sextant.data.photos import read_photo
from sextant.data.picture_files import UnreadableImageError
from sextant.data.pixel_values import WhiteLevels
from sextant.data.videos import Frame, Size, Video, is_video
from sextant.errors import UserError
from sextant.tables import counted

#: files written into the output folder, which may be the folder of the photos
WRITTEN = ("trajectory.png", "from_above.png")


@dataclass(frozen=True, eq=False)
class Photos:
    """Photos in the natural order of their names.

    Attributes:
        folder: that the names are relative to.
        names: of the files.
        times_s: from the names, if all contain a time, or None.
    """

    folder: Path
    names: tuple[str, ...]
    times_s: Float64[ndarray, "n"] | None

    def __len__(self) -> int:
        return len(self.names)

    def read(self, size: Size | None) -> Iterator[Frame]:
        """Yield all images, stretched to a size or in colour as they are; those that cannot be decoded are reported."""
        levels = WhiteLevels(self.folder / name for name in self.names)
        for name in self.names:
            path = self.folder / name
            if not path.is_file():
                yield Frame(name, None, "is a broken link" if path.is_symlink() else "there is no such file")
                continue
            try:
                yield Frame(name, read_photo(path, levels).image if size is None else decode_image(path, *size, levels))
            except (UnreadableImageError, UserError) as error:
                yield Frame(name, None, reason_alone(str(path), str(error)))

    def in_order_of(self, names: Sequence[str], given: Path) -> "Photos":
        """The photos in the order of a table's rows; a row whose file is missing is a frame without an image.

        Raises:
            UserError: a photo has no row or several, or times do not increase in the order of the rows.
        """
        rows = match_names(self.names, names).refuse_ambiguous(f"odometry={given}").rows
        if missing := [name for name, row in zip(self.names, rows, strict=True) if row is None]:
            raise UserError(
                f"odometry={given} has no row for {len(missing):,} of {counted(len(self), 'photo')}, such as "
                f"{missing[0]}",
                "One row per image, with its file name relative to the folder; or leave out the column file.",
            )
        photos = {row: name for name, row in zip(self.names, rows, strict=True)}
        times = None if len(names) != len(self.names) else self.times_s
        order = [photos.get(row, Path(name).as_posix()) for row, name in enumerate(names)]
        if order != list(self.names) and times is not None:
            times = np.array([times[self.names.index(name)] for name in order])
            check_rising(times, order, f"odometry={given}")
        return Photos(self.folder, tuple(order), times)


def find_frames(given: str, output: Path, every: int) -> Photos | Video:
    """The photos or the video that ``input=`` names.

    Raises:
        UserError: there are none, the video cannot be opened, photos are out of order, or ``every`` is given for
            photos.
    """
    path = Path(given).expanduser()
    if is_video(path):
        return Video.open(path, every)
    if every != 1:
        raise UserError(f"every={every} applies to a video; input={given} is not one", "Leave out every=.")
    mine = output.resolve()
    found = [p for p in find_photos(given, output) if not _is_written(p, mine)]
    if not found:
        raise UserError(f"input={given}: no photo there", "Give a folder of photos, a video, or a ROS bag.")
    folder, parents = Path(), {p.parent for p in found}  # several folders of a relative pattern: as it names them
    if path.is_dir():
        folder = path
    elif len(parents) == 1 or path.is_absolute():
        folder = Path(os.path.commonpath(parents))
    names = sorted((p.relative_to(folder).as_posix() for p in found), key=natural_key)
    times = times_of_names([Path(name) for name in names])
    if times is not None:
        check_rising(times, names, f"input={given}")
    return Photos(folder, tuple(names), times)


def _is_written(photo: Path, output: Path) -> bool:
    """Whether a picture is one that localizing or locating wrote."""
    if photo.parent.name == "matches":
        return _of_localizing(photo.parent.parent, output)
    return photo.name in WRITTEN and _of_localizing(photo.parent, output)


def _of_localizing(folder: Path, output: Path) -> bool:
    return folder.resolve() == output or (folder / "poses.csv").is_file()
