"""When images were taken, and where a trajectory was at that time.

Times in names are read by these forms alone, anywhere in a name unless stated otherwise; other numbers, such as
eastings, exposures, versions, counters and a clock time without a date, are not times:

============================ ========================================================================================
seconds since 1970           ``1305031102.175304``, ``1305031102_175304000`` (9 or 6 digits after ``_`` or ``-``)
a whole number since 1970    10 digits are seconds, 13 milliseconds, 16 microseconds, 19 nanoseconds; the first digit
                             is 1, which is 2001 to 2033
date and time                ``20230101_120055``, ``PXL_20230101_120055123``, ``2023-01-01T12-00-55.5Z``; separators
                             may be missing; decimals follow a dot or comma, or are 3, 6 or 9 digits, which may follow
                             ``_`` or ``-``; without a zone it is UTC
seconds of a recording       the whole name is one number below 100,000 with at least two decimals, equally many in all
============================ ========================================================================================
"""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from sextant.errors import ArgumentError, UserError, problem_list
from sextant.tables import counted
from sextant.user_files import read_lines

#: an image this near to a pose in time has that pose
SAME_S = 1e-3
SECOND = 10**9
#: number of digits of a time since 1970 -> nanoseconds of its unit
EPOCH_UNITS = {10: SECOND, 13: 10**6, 16: 10**3, 19: 1}
#: successive exposures of a bracket have about this ratio or a larger one; successive times never keep it
BRACKET, ALIKE = 1.2, 0.2


def epoch_ns(number: str) -> int | None:
    """Nanoseconds since 1970 of a whole number in any of four units, or None if it is none of 2001 to 2033."""
    unit = EPOCH_UNITS.get(len(number)) if number.isdecimal() and number.startswith("1") else None
    return None if unit is None else int(number) * unit


def _decimal_ns(found: re.Match[str]) -> int:
    return int(found[1]) * SECOND + int(found[2][:9].ljust(9, "0"))


def _date_ns(found: re.Match[str]) -> int | None:
    try:
        at = datetime(*(int(found[k]) for k in (1, 2, 3, 5, 6, 7)), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError:  # 31 February
        return None
    zone = (found["zone"] or "Z").replace(":", "")
    if zone != "Z":
        away = timedelta(hours=int(zone[1:3]), minutes=int(zone[3:]))
        at += away if zone[0] == "-" else -away
    decimals = next(filter(None, (found["dotted"], found["apart"], found["attached"])), "")
    return round((at - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()) * SECOND + int(decimals.ljust(9, "0"))


_DECIMALS = re.compile(r"(?<![\d.])(1\d{9})\.(\d{1,12})(?!\.?\d)")
_NANOSECONDS = re.compile(r"(?<![\d.])(1\d{9})[-_](\d{9}|\d{6})(?!\d)")
_WHOLE = re.compile(r"(?<!\d)1(?:\d{18}|\d{15}|\d{12}|\d{9}(?!\.\d))(?!\d)")
_DATE = re.compile(
    r"(?<!\d)((?:19[89]|20[0-4])\d)[-_.:]?(0[1-9]|1[0-2])[-_.:]?(0[1-9]|[12]\d|3[01])(?:(?P<iso>T)| at |[-_. ])?"
    r"([01]\d|2[0-3])[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)"
    r"(?:[.,](?P<dotted>\d{1,9})|[-_](?P<apart>\d{6}|\d{3})|(?P<attached>\d{9}|\d{6}|\d{3}))?(?!\d|\s?[AaPp][Mm])"
    r"(?P<zone>(?(iso)Z|(?!))|(?(iso)[+-](?:0\d|1[0-4]):?[0-5]\d|(?!)))?"
)
_RECORDING = re.compile(r"^(?!\d{6}\.)(\d{1,5}|0\d{6,})\.(\d{2,9})$")
#: forms of times, the most reliable first, each with its conversion to nanoseconds
FORMS: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], int | None]], ...] = (
    (_DECIMALS, _decimal_ns),
    (_NANOSECONDS, _decimal_ns),
    (_WHOLE, lambda found: epoch_ns(found[0])),
    (_DATE, _date_ns),
    (_RECORDING, _decimal_ns),
)


def _found(name: str, form: re.Pattern[str], nanoseconds: Callable[[re.Match[str]], int | None]) -> list[int]:
    return [time for found in form.finditer(name) if (time := nanoseconds(found)) is not None]


def _stem(name: str) -> str:
    return re.sub(r"\.[A-Za-z]\w*$", "", name)  # no suffix begins with a digit, but decimals do


def times_of_names(paths: Sequence[Path]) -> Float64[ndarray, "n"] | None:
    """Seconds in the names of images, which follow one form of the module's; None if they do not.

    Of several times in each name, the one that differs from name to name counts. Digits are kept down to nanoseconds,
    and then rounded once. There are no times if all are the same, or several images have the same whole second.
    """
    names = [_stem(path.name) for path in paths]
    for form, nanoseconds in FORMS:
        found = [_found(name, form, nanoseconds) for name in names]
        if not names or not all(found) or len(set(map(len, found))) > 1:
            continue
        columns = list(zip(*found, strict=True))
        told = [column for column in columns if len(set(column)) > 1] if len(names) > 1 else columns
        if len(told) == 1 and _are_times(names, told[0], form):
            return np.array([time / SECOND for time in told[0]])
    return None


def _are_times(names: Sequence[str], times: Sequence[int], form: re.Pattern[str]) -> bool:
    """Whether numbers in the form of a time are times, and not a counter, decimals without zeros or exposures."""
    whole = all(time % SECOND == 0 for time in times)
    if whole and len(set(times)) < len(times):
        return False
    if form is _DATE:  # a counter after a date: 20230101_000012
        return not whole or max(time % (86400 * SECOND) for time in times) >= 60 * SECOND
    decimals = [found[2] for name in names if (found := form.search(name)) and form.groups]
    lengths = set(map(len, decimals))
    if form is _DECIMALS:  # sec.nsec whose zeros were left out
        return len(lengths) == 1 or max(lengths) != 9 or any(part[0] == "0" for part in decimals if len(part) > 1)
    if form is _RECORDING:
        ratios = np.array(times[1:]) / np.maximum(np.array(times[:-1]), 1)
        bracket = len(times) > 2 and ratios.min() > BRACKET and np.ptp(ratios) < ALIKE * ratios.min()
        return max(times) < 100_000 * SECOND and not bracket and len(lengths) == 1
    return True


def names_without_time(names: Sequence[str]) -> list[str]:
    """The names that contain no time of a known form."""
    return [name for name in names if not any(_found(_stem(name), *form) for form in FORMS)]


def no_times(names: Sequence[str]) -> str:
    """Why names contain no times, for messages."""
    if without := names_without_time(names):
        return (
            f"{len(without):,} of {counted(len(names), 'name')} {'contains' if len(without) == 1 else 'contain'} no "
            f"time of a known form, such as {without[0]}"
        )
    return f"the times in the names are of several forms, or the same in several names: {names[0]} to {names[-1]}"


def times_of_file(path: Path, count: int) -> Float64[ndarray, "n"]:
    """Seconds in a file with one line per image.

    Raises:
        UserError: the file cannot be read, or does not have ``count`` finite numbers.
    """
    fix = "One line per image, in seconds."
    try:
        times = np.array([float(word) for _, words in read_lines(path, fix) for word in words])
    except ValueError as error:
        raise UserError(f"{path} cannot be read as times: {error}", fix) from None
    if len(times) != count or not np.isfinite(times).all():
        raise UserError(f"{path} has {len(times):,} times for {counted(count, 'image')}", fix)
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
    found, known, nearest = interpolated(times_s, poses, wanted_s, np.inf if max_gap_s is None else max_gap_s)
    if wrong := np.flatnonzero(~known).tolist():
        listed = problem_list([f"{names[i]} at {wanted_s[i]:.6f} s: nearest is {nearest[i]:.3f} s off" for i in wrong])
        raise ArgumentError(
            f"{key}: {len(wrong):,} of {counted(len(names), 'image')} "
            f"{'has no pose at its' if len(wrong) == 1 else 'have no pose at their'} time ({times_s[0]:.6f} s to "
            f"{times_s[-1]:.6f} s, gaps up to max_gap_s={max_gap_s})\n{listed}",
            "Remove these images, complete the trajectory, or allow wider gaps: max_gap_s=<seconds>",
        )
    found[:, 2] = (found[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return found


def interpolated(
    times_s: Float64[ndarray, "n"], poses: Float64[ndarray, "n 3"], wanted_s: Float64[ndarray, "m"], gap_s: float
) -> tuple[Float64[ndarray, "m 3"], Bool[ndarray, "m"], Float64[ndarray, "m"]]:
    """Poses at other times, interpolated linearly; which of them are known; and how far the nearest is in time.

    The heading turns the shorter way round, and is not wrapped. A row of nan makes only its neighbourhood unknown.

    Args:
        times_s: of the poses, increasing.
        poses: of the trajectory.
        wanted_s: other times.
        gap_s: widest gap of the trajectory in which a pose is known.

    Example:
        >>> times, line = np.arange(4.0), np.array([[0.0, 0, 3], [np.nan] * 3, [2, 0, -3], [3, 0, -3]])
        >>> poses, known, _ = interpolated(times, line, np.array([0.5, 2.5, 9.0]), 1.0)
        >>> poses[:2].round(2).tolist(), known.tolist()  # -3 rad is 3.28 rad, a little more than 3
        ([[nan, nan, nan], [2.5, 0.0, 3.28]], [True, True, False])
    """
    after = np.clip(np.searchsorted(times_s, wanted_s), min(1, len(times_s) - 1), len(times_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.minimum(np.abs(wanted_s - times_s[before]), np.abs(wanted_s - times_s[after]))
    inside = (wanted_s >= times_s[0]) & (wanted_s <= times_s[-1]) & (times_s[after] - times_s[before] <= gap_s)
    turned = poses[:, 2].copy()
    fine = np.isfinite(turned)
    turned[fine] = np.unwrap(turned[fine])
    columns = (*poses[:, :2].T, turned)
    found = np.column_stack([np.interp(wanted_s, times_s, column) for column in columns])
    return found, inside | (nearest <= SAME_S), nearest
