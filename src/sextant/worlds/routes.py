"""Drives and walks through a town: a pose for each frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray
from scipy.signal import lfilter

from sextant.errors import UserError
from sextant.worlds.lane_path import LanePath, lane_path
from sextant.worlds.street_graph import StreetGraph

#: More frames than this are a mistake in a unit.
MAX_FRAMES = 20_000_000


@dataclass(frozen=True, eq=False)
class Route:
    """Where someone was at each frame.

    Attributes:
        times: seconds from the start.
        poses: x, y in metres and heading in radians in [-pi, pi).
        edges: the edge of the street graph for each frame.
        arc_m: metres along the ideal line through the same nodes, without wander; increases with time. Frames with
            equal ``arc_m`` of two traverses of the same nodes are at the same place, whatever the seeds and speeds.

    Example:
        >>> from sextant.worlds import grid_streets
        >>> route = drive(grid_streets(2, 1, spacing_m=100.0), [0, 1, 2], seed=0)  # ten frames a second
        >>> route.sample_by_distance(50.0).arc_m  # a frame every 50 m
        array([  0.,  50., 100., 150.])
    """

    times: Float[ndarray, " n"]
    poses: Float[ndarray, "n 3"]
    edges: Int64[ndarray, " n"]
    arc_m: Float[ndarray, " n"]

    def sample_by_distance(self, step_m: float) -> "Route":
        """Frames at ``arc_m = 0, step_m, 2 step_m, ...``, interpolated; frame i of every traverse is the same place.

        Raises:
            UserError: ``step_m`` is not positive or makes too many frames.
        """
        if not step_m > 0 or not self.arc_m[-1] / step_m < MAX_FRAMES:
            raise UserError(f"step_m={step_m:g} is out of range: it must be positive", "Try step_m=1")
        return self._at(np.arange(0.0, np.nextafter(self.arc_m[-1], np.inf), step_m))

    def _at(self, arc_m: Float[ndarray, " k"]) -> "Route":
        moving = np.r_[True, np.diff(self.arc_m) > 0]
        known, unwrapped = self.arc_m[moving], np.unwrap(self.poses[:, 2])[moving]
        heading = _wrapped(np.interp(arc_m, known, unwrapped))
        x, y = (np.interp(arc_m, known, self.poses[moving, k]) for k in (0, 1))
        last = np.searchsorted(known, arc_m, side="right") - 1
        times = np.interp(arc_m, known, self.times[moving])
        return Route(times, np.column_stack([x, y, heading]), self.edges[moving][last], arc_m)

    def align(self, other: "Route") -> Int64[ndarray, " n"]:
        """For each frame of this route, the frame of ``other`` nearest along the street.

        Both must be traverses of the same nodes. Where ``other`` stands still, its first frame there is taken.
        """
        middle = (other.arc_m[1:] + other.arc_m[:-1]) / 2
        return np.searchsorted(middle, self.arc_m).astype(np.int64)


@dataclass(frozen=True)
class Gait:
    """How someone moves.

    Attributes:
        speed_mps: on a straight street.
        acceleration_mps2, braking_mps2: along the line.
        sideways_mps2: largest ``speed² × curvature`` in a turn.
        stop_probability: at each junction; the wait is uniform, 1 to 6 seconds.
        lateral_sigma_m, lateral_length_m: offset from the ideal line, smooth: variance σ², correlation
            ``(1 + s/ℓ) exp(-s/ℓ)`` over s metres (an Ornstein-Uhlenbeck process passed through another).
        heading_sigma_rad, heading_length_m: of the gaze relative to the direction of travel, an Ornstein-Uhlenbeck
            process.
    """

    speed_mps: float
    acceleration_mps2: float
    braking_mps2: float
    sideways_mps2: float
    stop_probability: float
    lateral_sigma_m: float
    lateral_length_m: float
    heading_sigma_rad: float
    heading_length_m: float


DRIVER = Gait(12.0, 1.5, 2.0, 2.0, 0.3, 0.2, 12.0, 0.01, 5.0)
WALKER = Gait(1.4, 0.7, 0.7, 1.0, 0.1, 0.25, 6.0, 0.06, 2.0)


def drive(
    graph: StreetGraph, nodes: Sequence[int], *, seed: int, frame_rate_hz: float = 10.0, gait: Gait = DRIVER
) -> Route:
    """A drive through ``nodes`` in the right-hand lane, a quarter of the carriageway from its centre.

    However far it wanders, the car stays on the carriageway, but for corners that it may cut by up to 1.5 m. Speed
    starts and ends at 0 and is the highest within the limits of ``gait``. The seed determines wander and stops; the
    ideal line depends on the nodes alone.

    Raises:
        UserError: the nodes do not form a route (see `check_nodes`), or the frame rate is not in (0, 1000] Hz.

    >>> from sextant.worlds import grid_streets
    >>> first, second = (drive(grid_streets(2, 1, spacing_m=100.0), [0, 1, 2], seed=seed) for seed in (1, 2))
    >>> float(first.times[-1].round(1)), float(second.times[-1].round(1))  # the second stopped at a junction
    (23.6, 33.1)
    >>> a, b = (route.sample_by_distance(10.0).poses[:, :2] for route in (first, second))
    >>> bool(np.abs(a - b).max() < 1.5)  # the same places, but for where in the lane
    True
    """
    path = lane_path(graph, nodes, share=0.25)
    return _traverse(path, seed, frame_rate_hz, gait, to_kerb_m=graph.widths[path.edges] / 4)


def walk(
    graph: StreetGraph, nodes: Sequence[int], *, seed: int, frame_rate_hz: float = 5.0, gait: Gait = WALKER
) -> Route:
    """A walk through ``nodes`` on the right-hand pavement; otherwise as `drive`.

    It is 2.1 m from the carriageway and 1.2 m from parked cars.

    >>> from sextant.worlds import grid_streets
    >>> way = walk(grid_streets(2, 1, spacing_m=100.0), [0, 1, 2], seed=0)
    >>> float(way.times[-1].round(1)), float(way.poses[:, 1].mean().round())  # 200 m; 2.1 m beyond half of 8 m
    (144.8, -6.0)
    """
    return _traverse(lane_path(graph, nodes, share=0.5, beyond_m=2.1, radius_m=1.5), seed, frame_rate_hz, gait)


def _traverse(
    path: LanePath, seed: int, frame_rate_hz: float, gait: Gait, to_kerb_m: Float[ndarray, " n"] | float = np.inf
) -> Route:
    """``to_kerb_m`` is to the right; the other kerb is three times as far."""
    if not 0 < frame_rate_hz <= 1000:
        raise UserError(f"frame_rate_hz={frame_rate_hz:g} is out of range: it must be in (0, 1000]", "Try 10")
    rng = np.random.default_rng(seed)
    stops = path.stops[rng.uniform(size=len(path.stops)) < gait.stop_probability]
    speed = speed_profile(path, stops, gait)
    waits = np.zeros(len(speed))
    waits[stops] = rng.uniform(1.0, 6.0, len(stops))
    leave = np.cumsum(waits) + np.r_[0.0, np.cumsum(2 * np.diff(path.arc_m) / (speed[1:] + speed[:-1]))]
    if leave[-1] * frame_rate_hz > MAX_FRAMES:
        raise UserError(f"route: {leave[-1] * frame_rate_hz:,.0f} frames are too many", "Use a lower frame_rate_hz")
    times = np.arange(0.0, np.nextafter(leave[-1], np.inf), 1 / frame_rate_hz)
    arc = _arc_at(times, path.arc_m, speed, leave, leave - waits)
    poses = _wandering(path, rng, gait, to_kerb_m)
    x, y, heading = (np.interp(arc, path.arc_m, poses[:, k]) for k in range(3))
    edges = path.edges[np.searchsorted(path.arc_m, arc, side="right") - 1]
    return Route(times, np.column_stack([x, y, _wrapped(heading)]), edges, arc)


def _arc_at(
    times: Float[ndarray, " k"],
    arc_m: Float[ndarray, " n"],
    speed: Float[ndarray, " n"],
    leave: Float[ndarray, " n"],
    arrive: Float[ndarray, " n"],
) -> Float[ndarray, " k"]:
    """Arc length at ``times``: constant acceleration between samples, standing still from ``arrive`` to ``leave``."""
    i = np.clip(np.searchsorted(leave, times, side="right") - 1, 0, len(leave) - 2)
    elapsed = np.clip(times - leave[i], 0.0, arrive[i + 1] - leave[i])
    acceleration = (speed[i + 1] - speed[i]) / (arrive[i + 1] - leave[i])
    return np.asarray(np.clip(arc_m[i] + elapsed * (speed[i] + acceleration * elapsed / 2), arc_m[i], arc_m[i + 1]))


def speed_profile(path: LanePath, stops: Int64[ndarray, " k"], gait: Gait) -> Float[ndarray, " n"]:
    """The highest speed at each sample within the limits, 0 at both ends and at ``stops``.

    ``v² <= cap_j + 2 a |s - s_j|`` for every sample j, with a the acceleration behind j and the braking ahead of it.
    """
    cap = np.minimum(gait.speed_mps**2, gait.sideways_mps2 / np.maximum(np.abs(path.curvatures), 1e-9))
    cap[[0, -1, *stops.tolist()]] = 0.0
    up, down = 2 * gait.acceleration_mps2 * path.arc_m, 2 * gait.braking_mps2 * path.arc_m
    faster = up + np.minimum.accumulate(cap - up)
    slower = np.minimum.accumulate((cap + down)[::-1])[::-1] - down
    return np.asarray(np.sqrt(np.maximum(np.minimum(faster, slower), 0.0)))


def _wandering(
    path: LanePath, rng: np.random.Generator, gait: Gait, to_kerb_m: Float[ndarray, " n"] | float
) -> Float[ndarray, "n 3"]:
    """The line with lateral offset, and a heading that follows it and looks around."""
    at, step = _even(path.arc_m)
    room = np.interp(at, path.arc_m, np.broadcast_to(to_kerb_m, path.arc_m.shape))
    lateral = _smooth_noise(len(at), step / gait.lateral_length_m, rng) * gait.lateral_sigma_m
    lateral = np.clip(lateral, -room, 3 * room)
    gaze = _ornstein_uhlenbeck(len(at), step / gait.heading_length_m, rng) * gait.heading_sigma_rad
    offset = np.interp(path.arc_m, at, lateral)
    slope = np.interp(path.arc_m, at, np.gradient(lateral, step))
    left = np.column_stack([-np.sin(path.headings), np.cos(path.headings)])
    heading = path.headings + np.arctan(slope) + np.interp(path.arc_m, at, gaze)
    return np.column_stack([path.positions + offset[:, None] * left, heading])


def _even(arc_m: Float[ndarray, " n"]) -> tuple[Float[ndarray, " m"], float]:
    count = max(2, len(arc_m))
    at = np.linspace(0.0, arc_m[-1], count)
    return at, float(at[1])


def _ornstein_uhlenbeck(count: int, step: float, rng: np.random.Generator) -> Float[ndarray, " n"]:
    """Stationary, variance 1, correlation ``exp(-s)``, every ``step``."""
    keep = np.exp(-step)
    noise = rng.normal(size=count) * np.sqrt(1 - keep**2)
    noise[0] /= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], noise))


def _smooth_noise(count: int, step: float, rng: np.random.Generator) -> Float[ndarray, " n"]:
    """Stationary, variance 1, correlation ``(1 + s) exp(-s)``: AR(2) with a double pole, after a warm-up of 15."""
    keep = np.exp(-step)
    warm = int(np.ceil(15 / step))
    variance = (1 + keep**2) / (1 - keep**2) ** 3
    return np.asarray(
        lfilter([1.0], [1.0, -2 * keep, keep**2], rng.normal(size=warm + count))[warm:] / np.sqrt(variance)
    )


def _wrapped(angle: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
