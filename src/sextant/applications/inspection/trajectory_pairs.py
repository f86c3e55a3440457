"""Two files of poses of the same frames: an estimate and its reference."""

from collections.abc import Iterator
from itertools import combinations

from sextant.applications.inspection.poses import FoundPoses
from sextant.applications.inspection.seen import Seen
from sextant.applications.inspection.suggestion import Suggestion, command
from sextant.data.name_matching import match_names
from sextant.data.reconstructions import NAMED_FORMATS

#: largest number of commands
MOST = 3
#: words that the name of a reference contains
REFERENCE = ("ground", "gt", "truth", "ref", "poses")


def trajectory_pairs(seen: Seen) -> Iterator[Suggestion]:
    """``sextant trajectory`` for pairs that have frames in common."""
    usable = [each for each in seen.poses if not each.problem and each.poses is not None]
    pairs = [pair for pair in combinations(usable, 2) if _same_frames(*pair)]
    if not pairs:
        return
    commands = []
    for pair in pairs[:MOST]:
        files = [each.file for each in sorted(pair, key=lambda each: not _is_reference(each))]
        commands.append(command("trajectory", *(str(seen.folder / file) for file in files), "figure=plan.png"))
    why = f"{len(pairs):,} pairs of files have poses of the same frames; the reference comes first"
    yield Suggestion("compare two trajectories", why, tuple(commands))


def _same_frames(one: FoundPoses, other: FoundPoses) -> bool:
    if one.images is not None and other.images is not None and one.images != other.images:
        return False  # two drives
    if one.format in NAMED_FORMATS and other.format in NAMED_FORMATS:
        same = match_names(one.names, other.names)
        return any(row is not None for row in same.rows) and one.file.with_suffix("") != other.file.with_suffix("")
    if one.format != other.format:
        return False
    if one.times_s is not None and other.times_s is not None:
        return one.times_s[0] <= other.times_s[1] and other.times_s[0] <= one.times_s[1]
    first, second = one.file.stem, other.file.stem
    return one.count == other.count and (first in second or second in first)


def _is_reference(poses: FoundPoses) -> bool:
    name = poses.file.as_posix().lower()
    return any(word in name for word in REFERENCE)
