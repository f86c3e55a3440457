"""The contents of a user's own folder or video, and the tasks that fit them."""

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sextant.chapters.localization.data.rosbag import MAGIC
from sextant.chapters.places.data.gps_poses import doubtful
from sextant.data.image_files import SUFFIXES
from sextant.data.videos import VIDEOS
from sextant.errors import ArgumentError
from sextant.reporter import SILENT, Progress
from sextant.tables import counted
from sextant.tools.inspection.gps import extent_m, poses_by_gps, positions
from sextant.tools.inspection.photos import (
    camera_groups,
    described,
    duplicates,
    fit_for_calibration,
    panoramas,
    read_headers,
)
from sextant.tools.inspection.poses import FoundPoses, found_poses, odometry_tables, separate_models
from sextant.tools.inspection.seen import TABLES, FoundVideo, Seen, found_files, found_video, read_recordings
from sextant.tools.inspection.suggestion import Suggestion
from sextant.tools.inspection.suggestions import suggestions
from sextant.tools.inspection.times import folders_of_photos
from sextant.user_files import absent

#: what a file is that is none of those that can be inspected, and which these are
NO_KIND = "is no image, video, recording, poses or odometry"
KINDS = (
    f"Give a folder, a photo ({', '.join(SUFFIXES)}), a video ({', '.join(VIDEOS)}), a ROS bag ({', '.join(MAGIC)}) or "
    f"a file of poses or odometry ({', '.join(TABLES)})."
)


@dataclass(frozen=True, eq=False)
class Inspection:
    """The contents of a folder, and the tasks that fit them.

    Attributes:
        seen: what the folder contains.
        suggestions: tasks that fit, with their commands.
        remarks: remarks for the user.
    """

    seen: Seen
    suggestions: tuple[Suggestion, ...]
    remarks: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """Everything as plain values: the content of a JSON file."""
        seen, headers = self.seen, self.seen.headers.values()
        return {
            "input": str(seen.given),
            "images": len(headers),
            "sizes": [{"width": w, "height": h, "images": n} for (w, h), n in sizes(seen).items()],
            "cameras": [asdict(each) for each in seen.cameras],
            "gps": len(gps := positions(seen.headers)),
            "gps_doubtful": sum(bool(each.gps.position and each.gps.problem) for each in seen.headers.values()),
            "gps_directions": sum(each.direction_deg is not None for each in gps),
            "gps_extent_m": list(extent_m(gps)) if gps else None,
            "gravity": dict(Counter(each.gravity for each in headers if each.gravity)),
            "panoramas": [path.as_posix() for path in seen.panoramas],
            "duplicates": [list(group) for group in seen.duplicates],
            "folders": [
                {"folder": each.folder.as_posix(), "images": len(each.files), "times_from": each.times_from,
                 "first_s": each.times_s[0] if each.times_s else None,
                 "last_s": each.times_s[-1] if each.times_s else None,
                 "jumps": [{"before": name, "seconds": step} for name, step in each.jumps],
                 "backwards": list(each.backwards)}
                for each in seen.folders
            ],
            "videos": [asdict(each) for each in seen.videos],
            "recordings": [path.as_posix() for path in seen.recordings],
            "poses": [
                {"file": each.file.as_posix(), "format": each.format, "poses": each.count, "images": each.posed,
                 "images_without_pose": each.unposed, "poses_without_image": each.without_image,
                 "problem": each.problem or None, "remarks": list(each.remarks)}
                for each in seen.poses
            ],
            "odometry": [{"file": file.as_posix(), "rows": rows} for file, rows in seen.odometry.items()],
            "unreadable": dict(seen.unreadable),
            "suggestions": [asdict(each) for each in self.suggestions],
            "remarks": list(self.remarks),
        }  # fmt: skip


def sizes(seen: Seen) -> dict[tuple[int, int], int]:
    """Number of images by width and height, the most frequent size first."""
    return dict(Counter((each.width, each.height) for each in seen.headers.values()).most_common())


def inspect(input: Path | str, progress: Progress = SILENT.progress) -> Inspection:
    """Inspect a folder, a photo, a video or a file of poses, by headers, so that thousands of photos take seconds.

    Files of equal size are compared by content, and photos with the shape of a panorama are decoded at a small size.

    Args:
        input: what to inspect.
        progress: shows the progress of the work.

    Raises:
        ArgumentError: there is no such file or folder, or it is one file of which nothing can be read.

    Example:
        >>> found = inspect("photos")  # doctest: +SKIP
        >>> found.suggestions[0].commands  # doctest: +SKIP
        ('sextant predict input=photos output=calibrated camera=one',)
    """
    given = Path(input).expanduser()
    if not given.exists():
        raise ArgumentError(f"input={absent(given)}", "Give a folder of photos, or a video.")
    if not given.is_dir() and not given.is_file():  # reading a pipe might never end
        raise ArgumentError(f"input={given} is neither a folder nor a file", KINDS)
    folder = given if given.is_dir() else given.parent
    files = found_files(given)
    with progress("reading headers", "images") as advance:
        headers, unreadable = read_headers(folder, files.images, advance)
    with progress("looking for duplicates", "images") as advance:
        same = duplicates(headers, advance)
    with progress("looking for panoramas", "images") as advance:
        around = panoramas(headers, advance)
    videos: list[FoundVideo] = []
    for file in files.videos:
        video = found_video(folder / file, file.as_posix())
        if isinstance(video, str):
            unreadable[file.as_posix()] = video
        else:
            videos.append(video)
    recordings, damaged = read_recordings(folder, files.recordings)
    poses = [each for file in files.tables if (each := found_poses(folder, file, list(headers))) is not None]
    odometry, unusable = odometry_tables(folder, files.tables)
    photos = folders_of_photos(headers)
    seen = Seen(
        given, folder, files, headers, camera_groups(list(headers.values())), photos, around, same,
        videos, recordings, [*poses, *poses_by_gps(headers, photos)], odometry,
        {**files.unreadable, **unreadable, **damaged, **unusable},
    )  # fmt: skip
    found = Inspection(seen, tuple(suggestions(seen)), tuple(_remarks(seen)))
    if given.is_file() and not found.suggestions and (problem := _nothing_read(seen)):
        raise ArgumentError(f"input={given} {problem}", KINDS if problem == NO_KIND else "Correct or replace the file.")
    return found


def _nothing_read(seen: Seen) -> str:
    """Why nothing of a single file can be read; "" if something can."""
    if seen.headers or seen.videos or seen.recordings or seen.odometry or any(not each.problem for each in seen.poses):
        return ""
    reasons = [*seen.unreadable.values(), *(f"({each.format}): {each.problem}" for each in seen.poses)]
    empty = seen.given.stat().st_size == 0
    return "is empty (0 bytes)" if empty else (*reasons, NO_KIND)[0]


def _remarks(seen: Seen) -> list[str]:
    """Irregularities and their consequences."""
    said: list[str] = []
    photos = len(seen.headers) - len(seen.panoramas)
    if not seen.headers and not seen.videos and not (seen.poses or seen.odometry or seen.recordings):
        others = ", ".join(f"{count:,} {suffix}" for suffix, count in list(seen.files.others.items())[:5])
        said.append(
            "no image, video, recording, poses or odometry"
            + (" that can be read" if seen.unreadable else "" if others else ": there is nothing here")
            + f"; other files: {others}" * bool(others)
        )
    if seen.panoramas and photos:
        said.append(
            f"{counted(len(seen.panoramas), 'panorama')} of 360 degrees among {counted(photos, 'photo')}, such as "
            f"{seen.panoramas[0].as_posix()}: these are no photos through a lens, and commands for photos refuse them"
        )
    cameras = camera_groups(list(fit_for_calibration(seen.headers, seen.panoramas).values()))
    if len(cameras) > 1:
        said.append(f"photos of {described(cameras)}: camera=one is for the photos of one at a time")
    if seen.duplicates:
        more = sum(len(group) - 1 for group in seen.duplicates)
        said.append(
            f"{counted(more, 'image is a duplicate', 'images are duplicates')} of another, such as "
            f"{seen.duplicates[0][1]} = {seen.duplicates[0][0]}"
        )
    for missing, what in ((False, "doubtful"), (True, "left out")):
        found = {file.as_posix(): each.gps for file, each in seen.headers.items()}
        chosen = {name: gps.problem if (gps.position is None) is missing else "" for name, gps in found.items()}
        said += doubtful(chosen, what)
    for each in seen.folders:
        where = each.folder.as_posix()
        if each.jumps:
            name, step = each.jumps[0]
            said.append(
                f"{where}: {len(each.jumps):,} jumps in time by {each.times_from}, the first of {step:,.1f} s before "
                f"{name}: one drive should have none"
            )
        if each.backwards:
            said.append(
                f"{where}: the order of names differs from the order of time by {each.times_from} at "
                f"{len(each.backwards):,} places, the first {each.backwards[0]}"
            )
        if each.same_stem:
            said.append(
                f"{where}: {counted(len(each.same_stem), 'name differs', 'names differ')} only in suffix or case, "
                f"such as {each.same_stem[0]} and {each.same_stem[1]}"
            )
    said += [f"{link.as_posix()} is a link to a folder and was not followed" for link in seen.files.links]
    said += filter(None, [separate_models(seen.poses)])
    return said + [line for each in seen.poses for line in _remarks_on_poses(each)]


def _remarks_on_poses(poses: FoundPoses) -> list[str]:
    said = [f"{poses.file.as_posix()}: {remark}" for remark in poses.remarks]
    if poses.problem or poses.images is None:
        return said
    if poses.unposed and poses.posed:
        said.append(
            f"{poses.file.as_posix()}: {counted(poses.unposed, 'image')} in {poses.images.as_posix()} "
            f"{'has' if poses.unposed == 1 else 'have'} no pose"
        )
    if poses.without_image:
        said.append(f"{poses.file.as_posix()}: {counted(poses.without_image, 'pose has', 'poses have')} no image")
    if not poses.headings:
        said.append(f"{poses.file.as_posix()}: no column heading, which localization needs")
    return said
