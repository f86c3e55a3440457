"""When images were taken, and where a trajectory was at that time."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.places.problem_list import problem_list
from sextant.errors import ArgumentError, UserError

#: an image this near to a pose in time has that pose
SAME_S = 1e-3


def time_in_name(name: str) -> float | None:
    """Seconds in the name of an image, or None: ``1305031102.175304.png``, or whole nano- (19) or microseconds (16)."""
    if found := re.search(r"\d+\.\d+", name):
        return float(found.group())
    if found := re.search(r"(?<!\d)(\d{19}|\d{16})(?!\d)", name):
        digits = found.group()
        return int(digits) / (1e9 if len(digits) == 19 else 1e6)
    return None


def times_of_names(paths: Sequence[Path]) -> Float64[ndarray, "n"] | None:
    """Seconds in the names of images; None if a name has none, or all have the same, as in ``cam1.0_0001.png``."""
    times = [time_in_name(path.name) for path in paths]
    return None if None in times or len(set(times)) == 1 < len(times) else np.array(times, np.float64)


def times_of_file(path: Path, count: int) -> Float64[ndarray, "n"]:
    """Seconds in a file with one line per image.

    Raises:
        UserError: the file cannot be read, or does not have ``count`` finite numbers.
    """
    try:
        times = np.array([float(line) for line in path.read_text().split()])
    except (OSError, ValueError) as error:
        raise UserError(f"{path} cannot be read as times: {error}", "One line per image, in seconds.") from None
    if len(times) != count or not np.isfinite(times).all():
        raise UserError(f"{path} has {len(times):,} times for {count:,} images", "One line per image, in seconds.")
    return times


def check_rising(times_s: Float64[ndarray, "n"], names: Sequence[str], key: str) -> None:
    """Raise a ``UserError`` that names the first two images whose order in time differs from that of their names."""
    back = np.flatnonzero(np.diff(times_s) <= 0)
    if len(back):
        i = int(back[0])
        raise ArgumentError(
            f"{key}: images are out of order: {names[i + 1]} at {times_s[i + 1]:.6f} s comes after {names[i]} at "
            f"{times_s[i]:.6f} s ({len(back):,} such pairs)",
            "Images are read in the natural order of their names: rename them in the order they were taken, or correct "
            "the times.",
        )


def check_gaps(times_s: Float64[ndarray, "n"], names: Sequence[str], max_gap_s: float, key: str) -> None:
    """Raise a ``UserError`` that names pairs of images further apart in time than ``max_gap_s``."""
    gap = np.diff(times_s)
    wide = np.flatnonzero(gap > max_gap_s).tolist()
    if wide:
        listed = problem_list([f"{names[i]} to {names[i + 1]}: {gap[i]:.3f} s" for i in wide])
        raise ArgumentError(
            f"{key}: {len(wide):,} gaps in time above max_gap_s={max_gap_s:g}\n{listed}",
            "Split it into two drives, or allow such gaps: max_gap_s=<seconds>, or null for any.",
        )


def poses_at(
    times_s: Float64[ndarray, "n"],
    poses: Float64[ndarray, "n 3"],
    wanted_s: Float64[ndarray, "m"],
    names: Sequence[str],
    max_gap_s: float | None,
    key: str,
) -> Float64[ndarray, "m 3"]:
    """Poses in the plane at other times, interpolated linearly; the heading turns the shorter way round.

    Args:
        times_s: of the poses, increasing.
        poses: of the trajectory.
        wanted_s: times of the images.
        names: of the images, for messages.
        max_gap_s: widest gap of the trajectory in which an image may lie; None for any.
        key: config key and trajectory, for messages.

    Raises:
        UserError: an image is before the first pose, after the last, or in a wider gap; the message names such images.
    """
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, max(1, len(times_s) - 1))
    before = after - 1
    after = np.minimum(after, len(times_s) - 1)
    nearest = np.minimum(np.abs(wanted_s - times_s[before]), np.abs(wanted_s - times_s[after]))
    outside = (wanted_s < times_s[0]) | (wanted_s > times_s[-1])
    wide = times_s[after] - times_s[before] > (np.inf if max_gap_s is None else max_gap_s)
    wrong = np.flatnonzero((outside | wide) & (nearest > SAME_S)).tolist()
    if wrong:
        listed = problem_list([f"{names[i]} at {wanted_s[i]:.6f} s: nearest is {nearest[i]:.3f} s off" for i in wrong])
        raise ArgumentError(
            f"{key}: {len(wrong):,} of {len(names):,} images have no pose at their time "
            f"({times_s[0]:.6f} s to {times_s[-1]:.6f} s, gaps up to max_gap_s={max_gap_s})\n{listed}",
            "Remove these images, complete the trajectory, or allow wider gaps: max_gap_s=<seconds>",
        )
    x, y = (np.interp(wanted_s, times_s, poses[:, k]) for k in (0, 1))
    heading = np.interp(wanted_s, times_s, np.unwrap(poses[:, 2]))
    return np.column_stack([x, y, (heading + np.pi) % (2 * np.pi) - np.pi])
