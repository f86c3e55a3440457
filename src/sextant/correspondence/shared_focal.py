r"""The focal length that photos of a still scene share, from their matches alone.

For each focal length f of a grid, the relative pose of each pair of photos is that with most matches. From the valleys
of the summed errors the photos are joined to one scene and adjusted (:mod:`sextant.correspondence.bundle`), which gives
the deviation D(f), the minimum over poses, points, distortion and principal point, all around the best. With the
overdispersion :math:`\varphi` in the variance of a pixel, :math:`p(f) \propto e^{-D(f) / 2}` on a logarithmic scale
between fields of view of 110 and 14 degrees. Cameras that fixate one point from one distance, and flat scenes, have a
flat D; where p is wide, the answer is *undetermined*.

A camera that only turns has no points (:mod:`sextant.correspondence.turned_camera`).

Only distinct matches count: matches of a window with its neighbour agree with some epipolar geometry, too.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.ndimage import gaussian_filter1d

from sextant.correspondence.bundle import LARGEST_PX, Fit, Scene, Tracks, fitted, variance_of
from sextant.correspondence.first_scene import Pair, first_scene, joined
from sextant.correspondence.local_features import LocalFeatures
from sextant.correspondence.matching import distinct_matches
from sextant.correspondence.moving_scene import second_motion
from sextant.correspondence.pinhole import cross_matrices, sampson_errors
from sextant.correspondence.turned_camera import turned_focal, turns_of
from sextant.errors import ArgumentError, naming_extras, shown
from sextant.tables import counted

#: photos that are taken; time grows with the square, and ten determine a focal length to half a per cent
FEWEST, MOST = 2, 10
#: focal lengths that are tried first, in longer sides
GRID = np.geomspace(0.35, 4.0, 14)
#: matches of a pair by which its relative pose is found
MATCHES = 600
#: fewest matches of a pair that agree, and their least share of all; chance brings some
LEAST, LEAST_SHARE = 30, 0.1
#: share of the matches of a relative pose that a turn explains in photos of a camera that only turned
TURNED_SHARE = 0.9
#: focal lengths that turns are tried at: at one 1 % wrong, errors stay below the largest
TURNS = 121
#: By how much the variance of a pixel exceeds that of independent errors. The likeliest is 4.4 [2.4, 8.4] by 28 groups
#: of three and five photos by three cameras (python -m benchmarks.shared_focal sizes=3,5 groups=5 fit=true)
OVERDISPERSION = 4.0
#: relative standard deviation of a focal length that no number of photos undercuts: no camera is a pinhole with square
#: pixels and one coefficient of distortion (ten photos of the castle of ``strecha_posed`` are 0.6 % off)
MODEL = 0.005
#: deviations from the best within which focal lengths are weighed
WEIGHED = 25.0
#: largest relative standard deviation of an answer
WIDEST = 0.1
#: focal lengths from which a scene is built
VALLEYS = 3
#: points at which the posterior is evaluated
POINTS = 20_001


@dataclass(frozen=True, eq=False)
class SharedFocalLength:
    """The focal length of some photos. It is a ``CameraPrior``.

    Attributes:
        verdict: *known*; *unchecked* if only two photos show the scene, whose matches no third photo confirms: of the
            intervals of such pairs 7 of 12 held (results/localization.md); or why it is unknown: *no common scene* if
            too few matches agree, *moving scene* if matches show two motions
            (:mod:`sextant.correspondence.moving_scene`), *undetermined* if they agree with many focal lengths.
        focal_px: median of the posterior; nan if it is unknown.
        focal_sigma: its relative standard deviation; None if it is unknown.
        interval_px: holds the focal length with a probability of 95 %, also if the answer is *undetermined*.
        photos: numbers of the photos that were used.
        noise_px: standard deviation of a right pixel.
        turned: the camera only turned.
    """

    verdict: Literal["known", "unchecked", "undetermined", "moving scene", "no common scene"]
    focal_px: float = math.nan
    focal_sigma: float | None = None
    interval_px: tuple[float, float] = (0.0, math.inf)
    photos: Sequence[int] = field(default_factory=list)
    noise_px: float = math.nan
    turned: bool = False


@dataclass(frozen=True, eq=False)
class _Pair:
    """Matches of two photos: numbers of features, and pixels from the centres of the photos."""

    matches: Int64[ndarray, "m 2"]
    first: Float64[ndarray, "m 2"]
    second: Float64[ndarray, "m 2"]

    def some(self) -> "_Pair":
        step = max(1, math.ceil(len(self.matches) / MATCHES))
        return _Pair(self.matches[::step], self.first[::step], self.second[::step])

    def squared(self, focal: float, relative: ndarray) -> ndarray:
        """Squared Sampson errors in pixels."""
        essential = cross_matrices(relative[None, :3, 3])[0] @ relative[:3, :3]
        return (sampson_errors(self.first / focal, self.second / focal, essential) * focal) ** 2


@dataclass(frozen=True, eq=False)
class _Scanned:
    """Relative poses of pairs at one focal length, with their bounded errors and numbers of matches that agree."""

    focal: float
    relative: dict[Pair, ndarray]
    costs: dict[Pair, float]
    shares: dict[Pair, float]


def shared_focal_length(photos: Sequence[LocalFeatures]) -> SharedFocalLength:
    """The focal length of two to ten photos of one still scene by one camera.

    Args:
        photos: features of each. Square pixels and a principal point near the centre are assumed.

    Raises:
        ArgumentError: photos are not local features, there are fewer or more of them, or their sizes differ other than
            by turning the camera.
    """
    unit = _checked(photos)
    side = max(photos[0].width, photos[0].height) / unit
    pairs = dict(_pairs(photos, unit))
    some = {pair: each.some() for pair, each in pairs.items()}
    scan = [_scanned(some, focal * side) for focal in GRID]
    tracks = _tracks(photos, pairs, scan, unit)
    if tracks is None:
        return SharedFocalLength("no common scene")
    if _moving(pairs, scan):
        return SharedFocalLength("moving scene")
    turned = _turned(some, scan, side, unit)
    if turned is not None:
        return turned
    costs = np.array([sum(each.costs.values()) for each in scan])
    starts = []
    for k in sorted(_valleys(costs).tolist(), key=lambda k: costs[k])[:VALLEYS]:
        near = _scanned(some, _bottom(costs, k) * side)
        start = first_scene(tracks, near.focal, _used(near))
        if start is not None:
            starts.append(start)
    if not starts:
        return SharedFocalLength("undetermined")
    return _posterior(tracks, starts, unit)


def _checked(photos: Sequence[LocalFeatures]) -> float:
    """The side of a pixel that errors are measured in."""
    if not isinstance(photos, Sequence) or not all(isinstance(each, LocalFeatures) for each in photos):
        raise ArgumentError(
            f"photos={shown(photos)} must be a list of local features", "For example XFeatures().detect(images)"
        )
    if not FEWEST <= len(photos) <= MOST:
        raise ArgumentError(
            f"{counted(len(photos), 'photo')}; a shared focal length needs {FEWEST} to {MOST}",
            "Choose photos that overlap.",
        )
    sizes = {tuple(sorted((each.width, each.height))) for each in photos}
    if len(sizes) > 1:
        told = " and ".join(f"{wide}x{high}" for high, wide in sorted(sizes))
        raise ArgumentError(f"photos of {told} pixels have no focal length in pixels in common", "Scale them alike.")
    return max(each.pixel for each in photos)


def _centred(photo: LocalFeatures, rows: ndarray, unit: float) -> Float64[ndarray, "m 2"]:
    centre = (np.array([photo.width, photo.height]) - 1) / 2
    return np.asarray((photo.points[rows].astype(np.float64) - centre) / unit)


def _pairs(photos: Sequence[LocalFeatures], unit: float) -> Iterator[tuple[Pair, _Pair]]:
    for i, j in combinations(range(len(photos)), 2):
        matches = distinct_matches(photos[i], photos[j])
        if len(matches) >= LEAST:
            yield (
                (i, j),
                _Pair(matches, _centred(photos[i], matches[:, 0], unit), _centred(photos[j], matches[:, 1], unit)),
            )


def _scanned(pairs: Mapping[Pair, _Pair], focal: float) -> _Scanned:
    """The relative poses with most matches at a focal length."""
    with naming_extras("geometry of matches"):
        import poselib
    camera = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [focal, 0.0, 0.0]}
    ransac = {"max_epipolar_error": LARGEST_PX, "max_iterations": 1000, "min_iterations": 100}
    relative, costs, shares = {}, {}, {}
    for pair, each in pairs.items():
        found, _ = poselib.estimate_relative_pose(each.first, each.second, camera, camera, ransac, {})
        relative[pair] = np.eye(4)
        relative[pair][:3, :3], relative[pair][:3, 3] = found.R, found.t / max(float(np.linalg.norm(found.t)), 1e-12)
        squared = each.squared(focal, relative[pair])
        costs[pair] = float(np.minimum(squared, LARGEST_PX**2).sum())
        shares[pair] = float((squared < LARGEST_PX**2).mean())
    return _Scanned(focal, relative, costs, shares)


def _moving(pairs: Mapping[Pair, _Pair], scan: Sequence[_Scanned]) -> bool:
    """Whether most pairs that have a relative pose show a second motion."""
    told = []
    for pair, each in pairs.items():
        best = min(scan, key=lambda scanned, pair=pair: scanned.costs[pair])  # type: ignore[misc]
        squared = each.squared(best.focal, best.relative[pair])
        if (squared < LARGEST_PX**2).sum() >= LEAST:
            told.append(second_motion(each.first, each.second, squared, LARGEST_PX) > 0)
    return 2 * sum(told) > len(told)


def _turned(
    pairs: Mapping[Pair, _Pair], scan: Sequence[_Scanned], side: float, unit: float
) -> SharedFocalLength | None:
    """The answer if turns explain what relative poses do; None if they do not, or no pair has enough matches."""
    matched, agree = {}, {}
    for pair, each in pairs.items():
        most = max(scanned.shares[pair] for scanned in scan)
        if most >= LEAST_SHARE and most * len(each.first) >= LEAST:
            matched[pair], agree[pair] = (each.first, each.second), most * len(each.first)
    if not matched:
        return None
    focal, turns, explained = turns_of(matched, np.geomspace(GRID[0], GRID[-1], TURNS) * side)
    if sum(explained.values()) < TURNED_SHARE**4 * sum(agree.values()):  # before turns are fitted
        return None
    found = turned_focal(matched, focal, turns, side, ends=_ends(side), overdispersion=OVERDISPERSION, weighed=WEIGHED)
    if found.explained < TURNED_SHARE * sum(agree.values()):
        return None
    curve = found.logs, found.deviations
    return replace(_weighed([curve], side, unit), photos=found.photos, noise_px=found.variance**0.5 * unit, turned=True)


def _used(scanned: _Scanned) -> dict[Pair, ndarray]:
    return {pair: pose for pair, pose in scanned.relative.items() if scanned.shares[pair] >= LEAST_SHARE}


def _tracks(
    photos: Sequence[LocalFeatures], pairs: Mapping[Pair, _Pair], scan: Sequence[_Scanned], unit: float
) -> Tracks | None:
    """What is seen: matches that agree with the best relative pose of their pair at any focal length."""
    links = {}
    for pair, each in pairs.items():
        best = min(scan, key=lambda scanned, pair=pair: scanned.costs[pair])  # type: ignore[misc]
        agree = each.squared(best.focal, best.relative[pair]) < LARGEST_PX**2
        if agree.sum() >= LEAST and agree.mean() >= LEAST_SHARE:
            links[pair] = each.matches[agree]
    if not links:
        return None
    photo, feature, track = joined(links)
    pixels = np.empty((len(photo), 2))
    for k in np.unique(photo).tolist():
        pixels[photo == k] = _centred(photos[k], feature[photo == k], unit)
    wide = np.array([each.width >= each.height for each in photos])
    side = max(photos[0].width, photos[0].height) / unit
    return Tracks(pixels, photo, track, (wide != wide[0]).astype(np.int64), side)


def _valleys(costs: Float64[ndarray, "g"]) -> Int64[ndarray, "_"]:
    """Which values are not above their neighbours."""
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    return np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))


def _bottom(costs: Float64[ndarray, "g"], k: int) -> float:
    """Where the parabola through a valley of the grid and its neighbours is lowest, in longer sides."""
    if not 0 < k < len(costs) - 1:
        return float(GRID[k])
    before, here, after = costs[k - 1 : k + 2]
    shift = (before - after) / max(2 * (before - 2 * here + after), 1e-9)
    return float(GRID[k] * (GRID[1] / GRID[0]) ** np.clip(shift, -0.5, 0.5))


def _posterior(tracks: Tracks, starts: Sequence[tuple[Tracks, Scene, list[int]]], unit: float) -> SharedFocalLength:
    """Deviations along the focal length, and what follows from them; pixels without a point have the largest error."""
    variance = min(_settled(seen, scene) for seen, scene, _ in starts) * OVERDISPERSION
    curves, photos, least = [], list[int](), math.inf
    for seen, scene, numbers in starts:
        missing = (len(tracks.pixels) - len(seen.pixels)) * LARGEST_PX**2 / variance
        fits = _along(seen, fitted(seen, scene, variance, free=True), variance)
        own = np.array([each.deviation + missing for each in fits])
        if own.min() < least:
            least, photos = float(own.min()), numbers
        curves.append((np.array([each.log_focal for each in fits]), own))
    noise = math.sqrt(variance / OVERDISPERSION) * unit
    found = replace(_weighed(curves, tracks.side, unit), photos=sorted(photos), noise_px=noise)
    return replace(found, verdict="unchecked") if found.verdict == "known" and len(photos) == FEWEST else found


def _ends(side: float) -> tuple[float, float]:
    """Logarithms of the least and the largest focal length."""
    return math.log(GRID[0] * side), math.log(GRID[-1] * side)


def _weighed(curves: Sequence[tuple[ndarray, ndarray]], side: float, unit: float) -> SharedFocalLength:
    """What follows from deviations at logarithms of the focal length, the least of several."""
    ends = _ends(side)
    fine = np.linspace(*ends, POINTS)
    least = np.min([np.interp(fine, x, y, left=np.inf, right=np.inf) for x, y in curves], axis=0)
    weights = np.exp(-(least - least.min()) / 2)
    weights = gaussian_filter1d(weights, MODEL * (POINTS - 1) / (ends[1] - ends[0]), mode="constant")
    share = np.cumsum(weights) / weights.sum()
    low, middle, high = (float(np.exp(fine[np.searchsorted(share, level)])) * unit for level in (0.025, 0.5, 0.975))
    mean = float((fine * weights).sum() / weights.sum())
    sigma = math.sqrt(float(((fine - mean) ** 2 * weights).sum() / weights.sum()))
    known = sigma <= WIDEST
    return SharedFocalLength(
        "known" if known else "undetermined",
        middle if known else math.nan,
        sigma if known else None,
        (low, high),
    )


def _settled(tracks: Tracks, scene: Scene) -> float:
    """The variance of a pixel after a first fit."""
    first = variance_of(tracks, scene)
    return variance_of(tracks, fitted(tracks, scene, first * OVERDISPERSION, free=True).scene)


def _along(tracks: Tracks, found: Fit, variance: float) -> list[Fit]:
    """Fits at focal lengths around a valley, ascending, as far as these are near its bottom."""
    low, high = _ends(tracks.side)
    bottom = min(max(found.log_focal, low), high)
    if bottom != found.log_focal:
        found = fitted(tracks, found.towards(bottom), variance, free=False)
    fits = [found]
    for way in (-1, 1):
        last, at, size = found, bottom, min(max(found.log_sigma / 2, 2e-4), 0.05)
        while low < at + way * 1e-9 < high and last.deviation < min(each.deviation for each in fits) + WEIGHED:
            at = min(max(at + way * size, low), high)
            last = fitted(tracks, last.towards(at), variance, free=False)
            fits.append(last)
            size *= 1.4
    return sorted(fits, key=lambda each: each.log_focal)
