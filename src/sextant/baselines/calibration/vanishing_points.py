r"""Vanishing points of a world of boxes by RANSAC: tilt, roll and focal length of a camera whose lens is known.

Two segments on lines :math:`l_1, l_2` meet in the vanishing point :math:`v_1 = l_1 \times l_2`; so do two others in
:math:`v_2`. If their axes are orthogonal, :math:`f^2 = -(v_1 \cdot v_2)` for points measured from the centre, and the
third axis is the cross product. Half of the hypotheses are made this way. Where an axis is parallel to the image, as in
any frontal or level view, this does not determine f. The other half therefore takes f from the prior, the first axis
from two segments, and the second axis from one more segment, orthogonal to the first. All are scored at once, and the
best few are refined.

Sources: J. Coughlan, A. Yuille, "Manhattan world", ICCV 1999; C. Rother, "A new approach to vanishing point detection
in architectural environments", BMVC 2000 (angle from the midpoint); P. Torr, A. Zisserman, "MLESAC", 2000 (the score).
"""

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import CalibrationBaseline, CalibrationEstimate, CameraPrior
from sextant.baselines.calibration.lens import apparent_k2, undistort_points
from sextant.baselines.calibration.line_segments import count_long, detect_segments, segment_lengths
from sextant.baselines.calibration.manhattan import (
    BELIEFS,
    FIRST_ROUND,
    ManhattanFit,
    fit_manhattan,
    msac_cost,
)
from sextant.baselines.calibration.robust_fit import HIGH, LOW

#: Number of hypotheses; of those that are refined; of segments, longest first, that hypotheses are scored on.
HYPOTHESES, REFINED, SCORED = 500, 3, 120
#: Fewest segments for which a frame is searched.
FEWEST = 3
#: Segments drawn for a frame.
PICKED = 4
#: Focal lengths, in image heights, accepted from two vanishing points; lines do not determine those of longer lenses.
MEASURED = 0.15, 8.0
#: Penalty per squared standard deviation from the prior, as a share of the segments' length.
PRIOR_WEIGHT = 0.01


class VanishingPoints(CalibrationBaseline):
    """Manhattan frame by RANSAC on line segments, then by least squares, for a lens of known distortion.

    Args:
        prior: belief about the camera; ``fit`` replaces it. The lens has its ``k1_hat``: 0 for a pinhole camera.
        seed: seed of the hypotheses; the same image and seed give the same camera.

    Example:
        >>> starts = np.mgrid[-3:4, -2:3].reshape(2, -1).T / 10
        >>> points = np.array([[-1.2, 0.0], [1.2, 0.0]])  # of two walls at a right angle: f² = 1.2 · 1.2
        >>> ends = [0.8 * starts + 0.2 * points[0], 0.8 * starts + 0.2 * points[1], starts + [0.0, 0.2]]
        >>> segments = np.stack([np.tile(starts, (3, 1)), np.concatenate(ends)], axis=1)
        >>> camera = VanishingPoints().calibrate_segments(segments).camera
        >>> round(float(camera.focal), 1), abs(round(float(camera.tilt), 2)), abs(round(float(camera.roll), 2))
        (1.2, 0.0, 0.0)
    """

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The camera that took ``image``; what the segments do not determine comes from the prior."""
        segments = detect_segments(image)
        return self.calibrate_segments(segments)

    def calibrate_segments(self, segments: Float64[ndarray, "n 2 2"]) -> CalibrationEstimate:
        """The camera of an image with ``segments`` (ends in image heights from the centre, longest first)."""
        found = find_frame(segments, self.prior_, seed=self.seed)
        if found is None:
            return CalibrationEstimate.of_prior(self.prior_, count_long(segments))
        covariance = found.covariance[np.ix_(BELIEFS, BELIEFS)]
        return CalibrationEstimate.of_vector(found.vector[BELIEFS], covariance, self.prior_, count_long(segments))


def find_frame(
    segments: Float64[ndarray, "n 2 2"], prior: CameraPrior, *, seed: int, bent: bool = False
) -> ManhattanFit | None:
    """The best Manhattan frame of segments for a lens with the prior's ``k1_hat``; None if there are too few.

    Args:
        segments: ends in image heights from the centre, longest first.
        prior: belief about the camera.
        seed: seed of the hypotheses.
        bent: whether the refinement fits ``k1_hat`` as well.
    """
    if len(segments) < FEWEST:
        return None
    k2_hat = apparent_k2(prior.k1_hat, prior.focal)
    straight = undistort_points(segments, prior.k1_hat, k2_hat)
    frames, focal = hypotheses(straight, prior, np.random.default_rng(seed))
    starts = _likeliest(upright(frames, focal, prior.k1_hat), prior)
    straight, frames, focal = straight[:SCORED], frames.astype(np.float32), focal.astype(np.float32)
    cost = msac_cost(frames, focal, straight.astype(np.float32))
    strangeness = np.square((starts[:, BELIEFS] - prior.vector) / np.array(prior.sigma)).sum(axis=1)
    cost = np.where(np.isfinite(starts).all(axis=1), cost + PRIOR_WEIGHT * strangeness, np.inf)
    best = [index for index in _distinct(np.argsort(cost, kind="stable"), starts) if np.isfinite(cost[index])]
    level = np.array([prior.tilt, prior.roll, 0.0, np.log(prior.focal), prior.k1_hat])
    candidates = [*(starts[index] for index in best), level][:REFINED]
    rough = [fit_manhattan(segments, start, prior, bent=False, thresholds=FIRST_ROUND) for start in candidates]
    return fit_manhattan(segments, min(rough, key=lambda fit: fit.cost).vector, prior, bent=bent)


def explained_share(segments: Float64[ndarray, "n 2 2"], prior: CameraPrior, *, seed: int) -> float:
    """Share of the longest segments' length that the best of many frames explains beyond chance, from 0 to 1.

    Where it is small, the scene is not a world of boxes, and a frame fitted to it is arbitrary. By chance, the best of
    all frames explains part of any n segments: the four that define it, and about a share of ``0.12 + 3 / n`` of the
    other n - 4, as measured on 4 to 200 random segments.

    Args:
        segments: ends in image heights from the centre, longest first.
        prior: belief about focal length and lens.
        seed: seed of the hypotheses.
    """
    if len(segments) < FEWEST:
        return 0.0
    straight = undistort_points(segments, prior.k1_hat, apparent_k2(prior.k1_hat, prior.focal))
    frames, focal = hypotheses(straight, prior, np.random.default_rng(seed))
    cost = msac_cost(frames.astype(np.float32), focal.astype(np.float32), straight[:SCORED].astype(np.float32))
    lengths = segment_lengths(segments[:SCORED])
    count = float(lengths.sum() ** 2 / np.square(lengths).sum())
    if count <= PICKED + 0.5:
        return 0.0
    chance = (PICKED + (count - PICKED) * (0.12 + 3 / count)) / count
    return max(float(1 - np.nan_to_num(cost, nan=1.0).min()) - chance, 0.0) / (1 - chance)


def hypotheses(
    segments: Float64[ndarray, "n 2 2"], prior: CameraPrior, generator: np.random.Generator
) -> tuple[Float64[ndarray, "h 3 3"], Float64[ndarray, "h"]]:
    """Orthogonal axes as columns, in the camera frame, with focal lengths; not finite where segments do not meet.

    Args:
        segments: straight segments, longest first.
        prior: belief about the focal length, where vanishing points do not determine it.
        generator: draws the picks.
    """
    ones = np.ones((len(segments), 1))
    lines = np.cross(np.hstack([segments[:, 0], ones]), np.hstack([segments[:, 1], ones]))
    weights = segment_lengths(segments)
    picks = generator.choice(len(segments), size=(HYPOTHESES, 4), p=weights / weights.sum())
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.cross(lines[picks[:, 0]], lines[picks[:, 1]])
        second = np.cross(lines[picks[:, 2]], lines[picks[:, 3]])
        square = -(first[:, :2] * second[:, :2]).sum(-1) / (first[:, 2] * second[:, 2])
        measured = (np.arange(HYPOTHESES) % 2 == 0) & (square > MEASURED[0] ** 2) & (square < MEASURED[1] ** 2)
        guessed = prior.focal * np.exp(prior.sigma[2] * generator.standard_normal(HYPOTHESES))
        focal = np.where(measured, np.sqrt(np.where(measured, square, 1)), np.clip(guessed, *np.exp([LOW[3], HIGH[3]])))
        one = _unit(_rays(first, focal))
        plane = lines[picks[:, 2]] * np.stack([focal, focal, np.ones_like(focal)], axis=-1)
        two = np.where(measured[:, None], _rays(second, focal), np.cross(one, plane))
        two = _unit(two - (two * one).sum(-1, keepdims=True) * one)
    return np.stack([one, two, np.cross(one, two)], axis=-1), focal


def _rays(points: Float64[ndarray, "h 3"], focal: Float64[ndarray, "h"]) -> Float64[ndarray, "h 3"]:
    return np.concatenate([points[:, :2] / focal[:, None], points[:, 2:]], axis=1)


def _unit(vectors: Float64[ndarray, "h 3"]) -> Float64[ndarray, "h 3"]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def upright(
    frames: Float64[ndarray, "h 3 3"], focal: Float64[ndarray, "h"], k1_hat: float
) -> Float64[ndarray, "3 h 5"]:
    """Tilt, roll, heading, log focal and k1_hat of frames, with each axis in turn as the zenith.

    Not finite where that would roll the camera by more than 45 degrees.
    """
    up = np.moveaxis(frames, -1, 0)  # (axis, h, 3)
    up = np.where(up[..., 1:2] > 0, -up, up)
    tilt, roll = np.arctan2(up[..., 2], np.hypot(up[..., 0], up[..., 1])), np.arctan2(-up[..., 0], -up[..., 1])
    roll = np.where(np.abs(roll) < np.pi / 4, roll, np.nan)
    side = np.roll(np.moveaxis(frames, -1, 0), -1, axis=0)  # any other axis gives the heading modulo a right angle
    (ct, st), (cr, sr) = (np.cos(tilt), np.sin(tilt)), (np.cos(roll), np.sin(roll))
    across = cr * side[..., 0] - sr * side[..., 1]
    ahead = st * (sr * side[..., 0] + cr * side[..., 1]) + ct * side[..., 2]
    heading = np.mod(np.arctan2(across, ahead) + np.pi / 4, np.pi / 2) - np.pi / 4
    lens = np.broadcast_to(np.stack([np.log(focal), np.full_like(focal, k1_hat)], axis=-1), (3, len(focal), 2))
    return np.concatenate([np.stack([tilt, roll, heading], axis=-1), lens], axis=-1)


def _likeliest(vectors: Float64[ndarray, "3 h 5"], prior: CameraPrior) -> Float64[ndarray, "h 5"]:
    """For each frame, the zenith with the likeliest tilt and roll; not finite where there is none."""
    off = (vectors[..., :2] - prior.vector[:2]) / np.array(prior.sigma[:2])
    zenith = np.nan_to_num(np.square(off).sum(-1), nan=np.inf).argmin(axis=0)
    return np.asarray(vectors[zenith, np.arange(len(zenith))])


def _distinct(order: Float[ndarray, "h"], starts: Float64[ndarray, "h 5"]) -> list[int]:
    """The first few indices of ``order`` that are not the same frame."""
    kept: list[int] = []
    for index in order[:50]:
        apart = [np.abs(starts[index] - starts[other])[:4].max() > 0.1 for other in kept]
        if all(apart):
            kept.append(int(index))
        if len(kept) == REFINED:
            break
    return kept
