"""A summary of what was found, a line for each kind."""

from collections import Counter
from collections.abc import Iterable
from datetime import timedelta

from sextant.data.photos.gps import GpsPosition
from sextant.tables import counted
from sextant.tools.inspection.gps import extent_m, positions
from sextant.tools.inspection.photos import CameraGroup
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.seen import FoundVideo, Seen
from sextant.tools.inspection.times import FolderOfPhotos

#: number of items that a line names; the rest is counted
NAMED = 5


def summary(seen: Seen) -> dict[str, str]:
    """Lines by what they describe; empty kinds are left out."""
    headers = list(seen.headers.values())
    sizes = Counter((each.width, each.height) for each in headers).most_common()
    gravity = Counter(each.gravity for each in headers if each.gravity)
    lines = {
        "images": f"{len(headers):,} ({sum(each.bytes for each in headers) / 1e6:,.1f} MB)" if headers else "",
        "sizes": _listed(f"{width}x{height} ({count:,})" for (width, height), count in sizes),
        "cameras": _listed(_camera(group) for group in seen.cameras if group.camera or group.focal_px),
        "panoramas": f"{len(seen.panoramas):,}" if seen.panoramas else "",
        "GPS": _gps(positions(seen.headers)),
        "gravity": _listed(f"{count:,} by {kind}" for kind, count in gravity.items()),
        "duplicates": f"{sum(len(group) - 1 for group in seen.duplicates):,}" if seen.duplicates else "",
        "order in time": _listed(_span(each) for each in seen.folders if each.times_s and len(each.files) > 1),
        "videos": _listed(map(_video, seen.videos)),
        "recordings": _listed(
            f"{path.as_posix()}{f': {text}' if text else ''}" for path, text in seen.recordings.items()
        ),
        "poses": _listed(map(_poses, seen.poses)),
        "odometry": _listed(f"{file.as_posix()}: {counted(rows, 'row')}" for file, rows in seen.odometry.items()),
        "cannot be read": f"{len(seen.unreadable):,}" if seen.unreadable else "",
    }
    return {name: text for name, text in lines.items() if text}


def _gps(found: list[GpsPosition]) -> str:
    if not found:
        return ""
    east, north = extent_m(found)
    directed, magnetic = sum(each.direction_deg is not None for each in found), sum(each.magnetic for each in found)
    compass = f" ({magnetic:,} by compass)" if magnetic else ""
    return f"{counted(len(found), 'image')} over {east:,.0f} x {north:,.0f} m, {directed:,} with a direction{compass}"


def _listed(lines: Iterable[str]) -> str:
    lines = list(lines)
    more = len(lines) - NAMED
    return "\n".join([*lines[:NAMED], *([f"and {more:,} more"] if more > 0 else [])])


def _camera(group: CameraGroup) -> str:
    focal = "" if group.focal_px is None else f", f {group.focal_px:.0f} px"
    return f"{group.camera or 'not named'}{focal}, {group.long}x{group.short} ({group.photos:,})"


def _span(each: FolderOfPhotos) -> str:
    assert each.times_s is not None
    seconds = timedelta(seconds=round(max(each.times_s) - min(each.times_s)))
    odd = [f"{len(each.jumps):,} jumps"] * bool(each.jumps) + [f"{len(each.backwards):,} backwards"] * bool(
        each.backwards
    )
    return f"{each.folder.as_posix()}: {counted(len(each.files), 'image')} in {seconds} by {each.times_from}" + (
        f", {', '.join(odd)}" if odd else ""
    )


def _video(each: FoundVideo) -> str:
    rate = f", {each.frames / each.per_second:,.1f} s, {each.per_second:.3g} Hz" if each.per_second else ""
    return f"{each.name}: {counted(each.frames, 'frame')} of {each.width}x{each.height}{rate}"


def _poses(each: FoundPoses) -> str:
    name = f"{each.file.as_posix()} ({each.format})"
    if each.problem:
        return f"{name}: {each.problem}"
    images = "" if each.images is None else f", of {each.posed:,} of {counted(each.posed + each.unposed, 'image')}"
    return f"{name}: {counted(each.count, 'pose')}{images}"
