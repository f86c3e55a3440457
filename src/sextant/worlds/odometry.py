"""Wheel odometry: a model of its errors, fitted to a real robot, and simulated odometry with such errors."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import nnls

from sextant.errors import UserError

#: Windows over which errors are collected by `fit_odometry_noise`: long enough that jitter of the true poses averages
#: out (on COLD it is 1 cm and 0.01 rad), short enough that there are many.
WINDOWS_M = (1.0, 2.0, 4.0)


@dataclass(frozen=True)
class OdometryNoise:
    """Errors of odometry in the Lie algebra se(2).

    With ``v = log(T_{t-1}⁻¹ T_t) = (v_x, v_y, ω)`` the true increment of the *wheel frame* (x ahead, origin at the
    axle) and ``d = |(v_x, v_y)|``, the odometry's increment is::

        u_x = (1 + forward_scale) v_x               + n_x
        u_y = v_y + lateral_bias · d                + n_y
        u_ω = (1 + turn_scale) ω + turn_bias · d    + n_ω      n_k ~ N(0, per_metre_k · d + per_radian_k · |ω|)

    Variances, not standard deviations, are proportional to motion, so the errors over a stretch do not depend on the
    number of frames it is divided into, and a robot at rest has none. There is no floor and no slowly varying bias:
    the data show neither (see `COLD_WHEELS`).

    Attributes:
        forward_scale, turn_scale: relative errors.
        lateral_bias: metres per metre.
        turn_bias: radians per metre; it makes a robot that believes it drives straight drive in a circle.
        per_metre: variance per metre of n_x, n_y in m²/m and n_ω in rad²/m.
        per_radian: variance per radian of n_x, n_y in m²/rad and n_ω in rad²/rad.
        lever_m: how far the frame of the given poses is ahead of the axle: calibration of the robot, not an error.
    """

    forward_scale: float
    turn_scale: float
    lateral_bias: float
    turn_bias: float
    per_metre: tuple[float, float, float]
    per_radian: tuple[float, float, float]
    lever_m: float = 0.0

    def scaled(self, factor: float) -> "OdometryNoise":
        """Errors ``factor`` times as large: biases scale with it, variances with its square; 0 is perfect odometry."""
        return replace(
            self,
            forward_scale=factor * self.forward_scale,
            turn_scale=factor * self.turn_scale,
            lateral_bias=factor * self.lateral_bias,
            turn_bias=factor * self.turn_bias,
            per_metre=_scaled(self.per_metre, factor**2),
            per_radian=_scaled(self.per_radian, factor**2),
        )


#: Fitted to 398 s and 68 m of real wheel odometry against laser localization (COLD, sequence 1, night):
#: ``python -c "import sys; from sextant.worlds.odometry import *; from sextant.worlds.trajectories import load_cold;
#: c = load_cold(sys.argv[1]); print(fit_odometry_noise(c.poses, c.odometry))" $SEXTANT_DATA/cold/seq1_night1.json``.
#: Refits to simulated drives scatter by 0.007, 0.004, 0.003 and 0.003 in the four systematic terms, so the two scales
#: are not distinguishable from 0, and the turn bias of 1.6 degrees per metre is. It grows with distance, not with time
#: or turning (regressed together), and the variance of what remains is proportional to distance from 1 m to 7 m and
#: smaller beyond: no sign of a bias that wanders.
COLD_WHEELS = OdometryNoise(
    forward_scale=0.0063,
    turn_scale=0.0069,
    lateral_bias=0.0044,
    turn_bias=0.0274,
    per_metre=(0.0021, 0.00038, 0.00038),
    per_radian=(0.0, 0.00036, 0.00013),
    lever_m=0.188,
)


def simulate(
    true_poses: Float[ndarray, "n 3"], noise: OdometryNoise, rng: np.random.Generator
) -> Float[ndarray, "n 3"]:
    """Odometry along true poses (x, y in metres, heading in radians), which starts at the first and drifts away.

    Poses are those of the given frame, `OdometryNoise.lever_m` ahead of the axle.
    """
    v = increments(at_axle(true_poses, noise.lever_m))
    moved, turned = np.hypot(v[:, 0], v[:, 1]), np.abs(v[:, 2])
    variance = np.outer(moved, noise.per_metre) + np.outer(turned, noise.per_radian)  # (n - 1, 3)
    u = v + rng.normal(size=v.shape) * np.sqrt(variance)
    u[:, 0] += noise.forward_scale * v[:, 0]
    u[:, 1] += noise.lateral_bias * moved
    u[:, 2] += noise.turn_scale * v[:, 2] + noise.turn_bias * moved
    axle = integrate(at_axle(true_poses[:1], noise.lever_m)[0], u)
    return at_axle(axle, -noise.lever_m)


def fit_odometry_noise(true_poses: Float[ndarray, "n 3"], odometry: Float[ndarray, "n 3"]) -> OdometryNoise:
    """Fit the model to a drive with ground truth.

    The lever is the regression of the sideways part of the true increments on the turn rate (an axle does not move
    sideways). Biases are least squares on sums over consecutive windows of 1 m; variances are non-negative least
    squares of squared errors on distance and turn, over all windows of 1, 2 and 4 m, weighted by 1 / window².
    Distances and turns are the odometry's, which do not jitter.

    Args:
        true_poses, odometry: x, y in metres and heading in radians at the same times, each in its own coordinates.

    Raises:
        UserError: the lengths differ, or the drive is shorter than 20 m.
    """
    if true_poses.shape != odometry.shape:
        raise UserError(
            f"odometry: {len(odometry)} poses for {len(true_poses)} true poses; they must be the same frames"
        )
    u = increments(odometry)
    lever = float(increments(true_poses)[:, 1] @ u[:, 2] / max(u[:, 2] @ u[:, 2], 1e-12))
    v = increments(at_axle(true_poses, lever))
    moved, turned = np.hypot(u[:, 0], u[:, 1]), np.abs(u[:, 2])
    if moved.sum() < 20:
        raise UserError(
            f"odometry: a drive of {moved.sum():.1f} m is too short to fit errors to: it needs at least 20 m"
        )
    window = np.floor(np.cumsum(moved) / WINDOWS_M[0]).astype(int)

    def sums(*columns: Float[ndarray, " n"]) -> Float[ndarray, "w k"]:
        return np.column_stack([np.bincount(window, column) for column in columns])

    error = u - v
    forward = _least_squares(sums(u[:, 0]), sums(error[:, 0]))
    sideways = _least_squares(sums(moved), sums(error[:, 1]))
    turn = _least_squares(sums(u[:, 2], moved), sums(error[:, 2]))
    # errors were regressed on odometry, which jitters less; the model scales the truth: u = v / (1 - a)
    scale = np.array([1 / (1 - forward[0]) - 1, 1 / (1 - turn[0]) - 1])
    bias = np.array([sideways[0], turn[1] / (1 - turn[0])])
    left = np.column_stack(
        [
            u[:, 0] - (1 + scale[0]) * v[:, 0],
            error[:, 1] - bias[0] * moved,
            u[:, 2] - (1 + scale[1]) * v[:, 2] - bias[1] * moved,
        ]
    )
    per_metre, per_radian = _variances(left, moved, turned)
    return OdometryNoise(
        forward_scale=float(scale[0]),
        turn_scale=float(scale[1]),
        lateral_bias=float(bias[0]),
        turn_bias=float(bias[1]),
        per_metre=per_metre,
        per_radian=per_radian,
        lever_m=lever,
    )


def _scaled(variances: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, turn = variances
    return factor * x, factor * y, factor * turn


def _least_squares(columns: Float[ndarray, "w k"], target: Float[ndarray, "w 1"]) -> Float[ndarray, " k"]:
    return np.asarray(np.linalg.lstsq(columns, target[:, 0], rcond=None)[0])


def _variances(
    error: Float[ndarray, "n 3"], moved: Float[ndarray, " n"], turned: Float[ndarray, " n"]
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Variance per metre and per radian of each component, from squared sums of errors over windows."""
    way, turn = np.r_[0.0, np.cumsum(moved)], np.r_[0.0, np.cumsum(turned)]
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(error, axis=0)])
    rows, squares = [], []
    for length in WINDOWS_M:
        first = np.flatnonzero(way + length < way[-1])
        last = np.searchsorted(way, way[first] + length)
        rows.append(np.column_stack([way[last] - way[first], turn[last] - turn[first]]) / length**2)
        squares.append((total[last] - total[first]) ** 2 / length**2)
    table, target = np.concatenate(rows), np.concatenate(squares)
    fits = [nnls(table, target[:, k])[0] for k in range(3)]
    (ax, ar), (bx, br), (cx, cr) = ((float(metre), float(radian)) for metre, radian in fits)
    return (ax, bx, cx), (ar, br, cr)


def drift(true_poses: Float[ndarray, "n 3"], odometry: Float[ndarray, "n 3"], length_m: float) -> tuple[float, float]:
    """Root mean square translation (metres) and heading error (radians) of odometry over stretches of ``length_m``.

    ``E = (T_i⁻¹ T_j)⁻¹ (O_i⁻¹ O_j)`` for every i, with j the first frame that is ``length_m`` further along the
    odometry, as in the KITTI benchmark (Geiger et al. 2012) but not divided by the length; nan if none is so long.
    """
    way = np.r_[0.0, np.cumsum(np.hypot(*increments(odometry)[:, :2].T))]
    first = np.flatnonzero(way + length_m < way[-1])
    last = np.searchsorted(way, way[first] + length_m)
    if len(first) == 0:
        return float("nan"), float("nan")
    real, told = (between(poses[first], poses[last]) for poses in (true_poses, odometry))
    error = between(real, told)
    return float(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean())), float(np.sqrt((error[:, 2] ** 2).mean()))


def at_axle(poses: Float[ndarray, "n 3"], lever_m: float) -> Float[ndarray, "n 3"]:
    """Poses of the frame ``lever_m`` further back."""
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2]), np.zeros(len(poses))])
    return np.asarray(poses - lever_m * ahead)


def between(a: Float[ndarray, "n 3"], b: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """``A⁻¹ B`` of poses in SE(2), the heading in [-pi, pi)."""
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    x, y = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, (b[:, 2] - a[:, 2] + np.pi) % (2 * np.pi) - np.pi])


def increments(poses: Float[ndarray, "n 3"]) -> Float[ndarray, "n-1 3"]:
    """``log(T_{t-1}⁻¹ T_t)`` in se(2): forward and left in metres, turn in radians.

    ``V⁻¹ t`` with ``V⁻¹ = [[k, ω/2], [-ω/2, k]]`` and ``k = (ω/2) cot(ω/2)`` (Solà, Deray & Atchuthan 2018, eq. 158).
    """
    step = between(poses[:-1], poses[1:])
    half = step[:, 2] / 2
    k = np.where(np.abs(half) < 1e-6, 1 - half**2 / 3, half / np.tan(np.where(half == 0, 1.0, half)))
    return np.column_stack([k * step[:, 0] + half * step[:, 1], k * step[:, 1] - half * step[:, 0], step[:, 2]])


def integrate(start: Float[ndarray, "3"], steps: Float[ndarray, "m 3"]) -> Float[ndarray, "m+1 3"]:
    """Poses from ``start`` by ``T_t = T_{t-1} exp(u_t)``, the inverse of `increments`."""
    turn = steps[:, 2]
    small = np.abs(turn) < 1e-6
    safe = np.where(small, 1.0, turn)
    a, b = np.where(small, 1 - turn**2 / 6, np.sin(safe) / safe), np.where(small, turn / 2, (1 - np.cos(safe)) / safe)
    x, y = a * steps[:, 0] - b * steps[:, 1], b * steps[:, 0] + a * steps[:, 1]
    heading = start[2] + np.r_[0.0, np.cumsum(turn)]
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    poses = np.column_stack(
        [np.r_[0.0, np.cumsum(cos * x - sin * y)], np.r_[0.0, np.cumsum(sin * x + cos * y)], heading]
    )
    poses[:, :2] += start[:2]
    poses[:, 2] = (heading + np.pi) % (2 * np.pi) - np.pi
    return poses
