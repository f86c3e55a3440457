"""Success of localization runs: whether they converge, how soon and for how long, by a `LocalizationProtocol`.

Errors are tables of runs by frames, with nan after the end of a drive and for frames without an estimate. Times are in
frames from the first one, which is 0. A run that never converged has the time ``NEVER``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy import ndarray
from scipy import stats

from sextant.evaluation.protocols import RECOVERY_HORIZON, LocalizationProtocol

#: Stands for the time of a run that never converged.
NEVER = -1


@dataclass(frozen=True)
class Share:
    """The share of independent runs for which something holds, with Wilson's score interval (Wilson 1927, JASA 22).

    Attributes:
        count: number of runs for which it holds.
        runs: number of all runs.
        rate: their quotient; nan without runs.
        low, high: ends of the interval for the probability.
    """

    count: int
    runs: int
    rate: float
    low: float
    high: float


@dataclass(frozen=True)
class ConvergenceSummary:
    """How many runs converged, and how long they took.

    Attributes:
        share: share of the runs that converged.
        median_frames, p90_frames: median and 90th percentile of their times to converge; nan if none did.
        tracking: share of later frames within the limits, averaged over those runs; nan if none did.
    """

    share: Share
    median_frames: float
    p90_frames: float
    tracking: float


def within(
    position: Float[ndarray, "runs frames"],
    heading_deg: Float[ndarray, "runs frames"] | None,
    protocol: LocalizationProtocol,
) -> Bool[ndarray, "runs frames"]:
    """Whether the errors of each frame are within the protocol's limits; nan is not.

    Args:
        position: errors in the protocol's unit.
        heading_deg: absolute errors in degrees; not used if the protocol has no heading.
        protocol: the limits.

    Raises:
        ValueError: an error is negative, or headings are needed and missing.

    >>> protocol = LocalizationProtocol(position=0.5, heading_deg=10.0, frames=2)
    >>> within(np.array([[0.4, 0.4, 0.6, np.nan]]), np.array([[5.0, 15.0, 5.0, 5.0]]), protocol)
    array([[ True, False, False, False]])
    """
    near = _within(position, protocol.position)
    if protocol.heading_deg is None:
        return near
    if heading_deg is None or heading_deg.shape != position.shape:
        raise ValueError(f"the protocol needs a heading error for each of {position.shape} position errors")
    return np.asarray(near & _within(heading_deg, protocol.heading_deg))


def converged_at(
    inside: Bool[ndarray, "runs frames"],
    frames: int,
    *,
    start: Int64[ndarray, " runs"] | int = 0,
    horizon: int | None = None,
) -> Int64[ndarray, " runs"]:
    """The first t from ``start`` on with frames t .. t + ``frames`` - 1 all within limits; ``NEVER`` if there is none.

    Args:
        inside: result of `within`.
        frames: number of consecutive frames.
        start: the first frame that counts, for all runs or for each.
        horizon: t is at most ``start`` + horizon; by default the drive's end.

    Raises:
        ValueError: ``frames`` is not positive or the horizon is negative.

    >>> inside = np.array([[True, False, True, True], [True, False, False, True]])
    >>> converged_at(inside, frames=2)
    array([ 2, -1])
    """
    if frames < 1 or (horizon is not None and horizon < 0):
        raise ValueError(f"frames={frames} must be positive and horizon={horizon} not negative")
    runs, length = inside.shape
    if length < frames:
        return np.full(runs, NEVER, np.int64)
    sums = np.cumsum(np.pad(inside, ((0, 0), (1, 0))), axis=1, dtype=np.int64)
    running = sums[:, frames:] - sums[:, :-frames] == frames  # (runs, frames that can be a t)
    begin = np.broadcast_to(np.asarray(start, np.int64), (runs,))[:, None]
    at = np.arange(running.shape[1])
    running = running & (at >= begin)
    if horizon is not None:
        running &= at <= begin + horizon
    return np.where(running.any(axis=1), running.argmax(axis=1), NEVER).astype(np.int64)


def tracking_share(
    inside: Bool[ndarray, "runs frames"],
    converged: Int64[ndarray, " runs"],
    length: Int64[ndarray, " runs"] | None = None,
) -> Float[ndarray, " runs"]:
    """Share of the frames from convergence to the end that are within limits; nan where a run never converged.

    Args:
        inside: result of `within`.
        converged: result of `converged_at`.
        length: number of frames of each drive, where they differ.

    >>> tracking_share(np.array([[False, True, True, False, True]]), np.array([1]))  # 3 of the 4 frames from 1 on
    array([0.75])
    """
    ends = np.full(len(inside), inside.shape[1]) if length is None else length
    at = np.arange(inside.shape[1])
    later = (at >= converged[:, None]) & (at < ends[:, None]) & (converged != NEVER)[:, None]
    with np.errstate(invalid="ignore"):
        return np.asarray((inside & later).sum(axis=1) / np.where(converged == NEVER, np.nan, later.sum(axis=1)))


def share_of(holds: Bool[ndarray, " runs"], confidence: float = 0.95) -> Share:
    """The share of runs for which something holds, with its interval.

    >>> found = share_of(np.ones(8, bool))
    >>> f"{found.rate:.2f} [{found.low:.2f}, {found.high:.2f}]"  # eight runs support no more than two in three
    '1.00 [0.68, 1.00]'
    """
    count, runs = int(holds.sum()), len(holds)
    if runs == 0:
        return Share(0, 0, float("nan"), 0.0, 1.0)
    interval = stats.binomtest(count, runs).proportion_ci(confidence, "wilson")
    return Share(count, runs, count / runs, float(interval.low), float(interval.high))


def global_localization(
    inside: Bool[ndarray, "runs frames"],
    protocol: LocalizationProtocol,
    *,
    horizon: int | None = None,
    length: Int64[ndarray, " runs"] | None = None,
) -> ConvergenceSummary:
    """Success from the start of the drives, the time to converge, and tracking thereafter.

    Args:
        inside: result of `within`.
        protocol: the protocol, with the number of consecutive frames.
        horizon: last frame at which a run may converge; by default the drive's end.
        length: number of frames of each drive that count, where they differ: all, or those before a kidnap.

    Raises:
        ValueError: the horizon is negative.

    >>> inside = np.array([[False, False, True, True, True, False], [False] * 6])  # two runs of six frames
    >>> found = global_localization(inside, LocalizationProtocol(position=0.5, heading_deg=10.0, frames=2))
    >>> found.share.rate, found.median_frames, found.tracking  # one run, from frame 2 on, for 3 of the 4 left
    (0.5, 2.0, 0.75)
    """
    inside = _until(inside, length)
    at = converged_at(inside, protocol.frames, horizon=horizon)
    return _summary(at, at, tracking_share(inside, at, length))


def recovery_after(
    inside: Bool[ndarray, "runs frames"],
    kidnapped_at: Int64[ndarray, " runs"],
    protocol: LocalizationProtocol,
    *,
    horizon: int = RECOVERY_HORIZON,
    length: Int64[ndarray, " runs"] | None = None,
) -> ConvergenceSummary:
    """Recovery from a kidnap: frame ``kidnapped_at`` is the first one at the new place, and times count from it.

    Args:
        inside: result of `within`.
        kidnapped_at: frame of the kidnap in each run.
        protocol: the protocol, with the number of consecutive frames.
        horizon: number of frames within which a run has to recover.
        length: number of frames of each drive that count, where they differ: all, or those before the next kidnap.

    Raises:
        ValueError: the horizon is negative.

    >>> inside = np.array([[True, True, False, False, True, True]])  # kidnapped at frame 2
    >>> found = recovery_after(inside, np.array([2]), LocalizationProtocol(position=0.5, heading_deg=10.0, frames=2))
    >>> found.share.count, found.median_frames
    (1, 2.0)
    """
    inside = _until(inside, length)
    at = converged_at(inside, protocol.frames, start=kidnapped_at, horizon=horizon)
    return _summary(at, at - kidnapped_at, tracking_share(inside, at, length))


def _until(
    inside: Bool[ndarray, "runs frames"], length: Int64[ndarray, " runs"] | None
) -> Bool[ndarray, "runs frames"]:
    return inside if length is None else inside & (np.arange(inside.shape[1]) < length[:, None])


def _within(errors: Float[ndarray, "runs frames"], limit: float) -> Bool[ndarray, "runs frames"]:
    if (errors < 0).any():
        raise ValueError("an error is negative; absolute errors are needed")
    return np.asarray(errors <= limit)  # nan is not


def _summary(
    at: Int64[ndarray, " runs"], took: Int64[ndarray, " runs"], tracking: Float[ndarray, " runs"]
) -> ConvergenceSummary:
    done = at != NEVER
    if not done.any():
        return ConvergenceSummary(share_of(done), float("nan"), float("nan"), float("nan"))
    median, p90 = np.percentile(took[done], (50, 90))
    return ConvergenceSummary(share_of(done), float(median), float(p90), float(tracking[done].mean()))
