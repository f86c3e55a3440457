"""A table of methods on photos of known cameras: areas under the recall curve, medians, intervals, verdicts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from numpy import ndarray

from sextant.chapters.calibration.metrics.errors import calibration_errors
from sextant.chapters.calibration.metrics.summary import AUC_DEG, ErrorSummary, Estimate, summary
from sextant.evaluation.conformal import cluster_resamples
from sextant.geometry import CameraParameters, vfov_from_focal, wrap_angle

#: columns of a table: title, error, digits, and whether it has areas under the recall curve
COLUMNS = (
    ("roll (°)", "roll_deg", 2, True),
    ("tilt (°)", "tilt_deg", 2, True),
    ("vfov (°)", "vfov_deg", 2, True),
    ("focal (%)", "focal_percent", 1, False),
    ("rays (°)", "bearing_deg", 2, False),
    ("k1/f²", "k1_hat", 3, False),
)
#: AUC@1/5/10 of roll, pitch and field of view as published by others, each on its own photos
PUBLISHED = (
    ("GeoCalib, LaMAR", "86.4 / 92.5 / 95.0", "55.0 / 76.9 / 86.2", "19.1 / 41.5 / 60.0"),
    ("GeoCalib, MegaDepth", "82.6 / 90.6 / 94.0", "32.4 / 53.3 / 67.5", "13.6 / 31.7 / 48.2"),
    ("GeoCalib, TartanAir", "71.3 / 83.8 / 89.8", "38.2 / 62.9 / 76.6", "14.1 / 30.4 / 47.6"),
    ("GeoCalib, Stanford2D3D", "83.1 / 91.8 / 94.8", "52.3 / 74.8 / 84.6", "17.4 / 40.0 / 59.4"),
    ("UVP, LaMAR", "72.7 / 81.8 / 85.7", "42.3 / 59.9 / 69.4", "15.6 / 30.6 / 43.5"),
    ("ParamNet, LaMAR", "51.7 / 77.0 / 86.0", "27.0 / 52.7 / 70.2", "2.8 / 6.8 / 14.3"),
    ("DeepCalib, LaMAR", "44.1 / 73.9 / 84.8", "10.8 / 28.3 / 49.8", "0.7 / 13.0 / 24.0"),
)
PUBLISHED_BY = "A. Veicht et al., GeoCalib, ECCV 2024 (github.com/cvg/GeoCalib, README)"
Table = tuple[list[str], list[list[str]]]
#: errors above which an answer is wrong: twice those within which it is right
WRONG = {"tilt_deg": 6.0, "roll_deg": 4.0, "focal_percent": 20.0}


@dataclass(frozen=True, eq=False)
class Answers:
    """One method's estimates for n photos.

    Attributes:
        cameras: tilt, roll, focal length (image heights) and k1; nan where it failed.
        half: by level, the half-widths of the intervals of tilt, roll, vfov (radians) and k1 / f².
        verdicts: one per photo.
    """

    cameras: Float64[ndarray, "n 4"]
    half: Mapping[str, Float64[ndarray, "n 4"]]
    verdicts: Sequence[str]


@dataclass(frozen=True, eq=False)
class Truth:
    """The true cameras of the photos.

    Attributes:
        cameras: tilt, roll, focal length (image heights) and k1; nan where unknown.
        aspect: width over height.
        clusters: photos of the same cluster are not independent.

    Example:
        >>> truth = Truth(np.array([[0.0, 0.0, 1.0, np.nan]]), aspect=np.array([1.5]), clusters=["hall"])
        >>> errors = truth.errors(np.array([[0.0, 0.0, 1.1, 0.0]]))
        >>> errors["focal_percent"].round(6), errors["k1"]  # the true k1 is not known
        (array([10.]), array([nan]))
    """

    cameras: Float64[ndarray, "n 4"]
    aspect: Float64[ndarray, "n"]
    clusters: Sequence[str]

    def errors(self, cameras: Float64[ndarray, "n 4"]) -> dict[str, Float[ndarray, "n"]]:
        """Errors of other cameras, by name; nan where the truth or the camera is unknown."""
        said, true = (CameraParameters(*torch.from_numpy(each.T.copy())) for each in (cameras, self.cameras))
        return calibration_errors(said, true, torch.from_numpy(self.aspect))

    def summaries(self, cameras: Float64[ndarray, "n 4"]) -> dict[str, ErrorSummary]:
        """Summary of each error over the photos whose truth is known; a failed photo counts as an infinite error."""
        errors, known = self.errors(cameras), self.errors(self.cameras)
        numbers = np.unique(np.array(self.clusters), return_inverse=True)[1]
        found: dict[str, ErrorSummary] = {}
        for _, name, _, _ in COLUMNS:
            there = np.isfinite(known[name])
            if there.any():
                found |= summary({name: errors[name][there]}, numbers[there])
        return found


def error_table(truth: Truth, methods: Mapping[str, Answers]) -> Table:
    """Medians with 95 % intervals over clusters, and AUC@1/5/10 in per cent, of each method.

    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]]), aspect=np.array([1.5]), clusters=["hall"])
    >>> titles, rows = error_table(truth, {"ours": Answers(np.array([[0.0, np.radians(2), 1.0, 0.0]]), {}, ["good"])})
    >>> titles[:4], rows[0][:4]
    (['method', 'photos', 'roll (°)', 'AUC@1/5/10'], ['ours', '1', '2.00', '0.0 / 70.0 / 85.0'])
    """
    titles = ["method", "photos"]
    for title, _, _, areas in COLUMNS:
        titles += [title, f"AUC@{'/'.join(map(str, AUC_DEG))}"] if areas else [title]
    rows = []
    for name, answers in methods.items():
        found, row = truth.summaries(answers.cameras), [name, str(len(truth.cameras))]
        for _, error, digits, areas in COLUMNS:
            of = found.get(error)
            row.append("–" if of is None else _with_interval(of.median, digits))
            if areas:
                row.append("–" if of is None else " / ".join(f"{100 * of.auc[t].value:.1f}" for t in AUC_DEG))
        rows.append(row)
    for name, *published in PUBLISHED:
        rows.append([f"*{name}*", "own", *(cell for area in published for cell in ("", area)), "", "", ""])
    return titles, rows


def interval_table(truth: Truth, methods: Mapping[str, Answers]) -> Table:
    """Coverage of the 68 and 95 % intervals, in per cent with intervals over clusters.

    Raises:
        ValueError: there is no method.

    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]] * 2), aspect=np.ones(2), clusters=["hall", "hall"])
    >>> tilted = truth.cameras + [[0.1, 0, 0, 0], [0.3, 0, 0, 0]]  # radians
    >>> interval_table(truth, {"ours": Answers(tilted, {95: np.full((2, 4), 0.2)}, ["good", "good"])})
    (['method', 'tilt, 95 %', 'roll, 95 %', 'vfov, 95 %'], [['ours', '50', '100', '100']])
    """
    if not methods:
        raise ValueError("methods is empty; the table has a row for each method and takes its columns from them")
    names = ("tilt", "roll", "vfov")
    rows = []
    for name, answers in methods.items():
        row = [name]
        off = np.abs(wrap_angle(torch.from_numpy(_angles(answers.cameras) - _angles(truth.cameras))).numpy())
        for k in range(len(names)):
            known = np.isfinite(_angles(truth.cameras)[:, k])
            owners = np.array(truth.clusters)[known]
            row += [_share((off[:, k] <= half[:, k])[known], owners) for half in answers.half.values()]
        rows.append(row)
    levels = list(next(iter(methods.values())).half)
    return ["method", *(f"{name}, {level} %" for name in names for level in levels)], rows


def verdict_table(truth: Truth, answers: Answers) -> Table:
    """For each verdict: the number of photos, their errors, and how many focal lengths are wrong (:data:`WRONG`).

    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]] * 2), aspect=np.ones(2), clusters=["hall", "hall"])
    >>> said = Answers(truth.cameras * [[1, 1, 1.1, 1], [1, 1, 1.5, 1]], {}, ["good", "weak"])
    >>> [[row[0], *row[-2:]] for row in verdict_table(truth, said)[1][:2]]  # per cent, and how many are too far off
    [['good', '10.0', '0'], ['weak', '50.0', '1']]
    """
    errors, wrong = truth.errors(answers.cameras), WRONG["focal_percent"]
    rows = []
    for verdict in ("good", "weak", "not trustworthy", "failed"):
        has = np.array([each == verdict for each in answers.verdicts], bool)
        cells = [_median(errors[name][has], digits) for _, name, digits, _ in COLUMNS[:4]]
        focal = errors["focal_percent"][has]
        rows.append([verdict, str(int(has.sum())), *cells, str(int((focal > wrong).sum()))])
    return ["verdict", "photos", *(title for title, _, _, _ in COLUMNS[:4]), f"focal off by over {wrong:.0f} %"], rows


def blame_table(truth: Truth, methods: Mapping[str, Answers]) -> Table:
    """Which part is to blame where the joint camera is wrong (:data:`WRONG`): the one that is wrong alone.

    Where both parts alone are right, their combination and the prior are.

    Args:
        truth: the true cameras.
        methods: answers of ``network``, ``lines`` and ``joint``.

    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]]), aspect=np.array([1.5]), clusters=["hall"])
    >>> right, wrong = (Answers(np.array([[0.0, 0.0, focal, 0.0]]), {}, ["good"]) for focal in (1.0, 1.5))
    >>> blame_table(truth, {"network": right, "lines": wrong, "joint": wrong})[1][2]
    ['focal (%) > 20', '1', '1', '0', '1', '0', '0']
    """
    titles = ["error", "photos", "joint wrong", "network to blame", "lines to blame", "both", "neither"]
    errors = {name: truth.errors(answers.cameras) for name, answers in methods.items()}
    known, rows = truth.errors(truth.cameras), []
    for error, most in WRONG.items():
        there = np.isfinite(known[error])
        network, lines, joint = (~(errors[name][error] <= most) & there for name in ("network", "lines", "joint"))
        parts = (network & ~lines, lines & ~network, network & lines, ~network & ~lines)
        title = next(title for title, name, _, _ in COLUMNS if name == error)
        rows.append(
            [f"{title} > {most:g}", *(str(int(each.sum())) for each in (there, joint, *(joint & p for p in parts)))]
        )
    return titles, rows


def worst_table(truth: Truth, names: Sequence[str], methods: Mapping[str, Answers], count: int = 5) -> Table:
    """The photos whose joint cameras are worst, with the errors of all methods; errors count in units of :data:`WRONG`.

    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]] * 2), aspect=np.ones(2), clusters=["hall", "hall"])
    >>> said = Answers(truth.cameras * [[1, 1, 1.1, 1], [1, 1, 1.5, 1]], {}, ["good", "weak"])
    >>> worst_table(truth, ["a.jpg", "b.jpg"], {"joint": said}, count=1)[1]
    [['b.jpg', 'weak', '0.0', '0.0', '50.0']]
    """
    errors = {name: truth.errors(answers.cameras) for name, answers in methods.items()}
    units = np.stack([errors["joint"][error] / most for error, most in WRONG.items()])
    size = np.where(np.isnan(methods["joint"].cameras[:, 2]), np.inf, np.nan_to_num(units).max(axis=0))
    titles = {error: title for title, error, _, _ in COLUMNS}
    columns = [(name, error) for error in WRONG for name in methods]
    rows = [
        [
            names[i],
            methods["joint"].verdicts[i],
            *(_median(errors[name][error][i : i + 1], 1) for name, error in columns),
        ]
        for i in np.argsort(-size, kind="stable")[:count]
    ]
    return ["photo", "verdict", *(f"{titles[error]}, {name}" for name, error in columns)], rows


def _angles(cameras: Float64[ndarray, "n 4"]) -> Float64[ndarray, "n 3"]:
    vfov = vfov_from_focal(torch.from_numpy(cameras[:, 2].copy())).numpy()
    return np.column_stack([cameras[:, 0], cameras[:, 1], vfov])


def _with_interval(of: Estimate, digits: int) -> str:
    return f"{of.value:.{digits}f}" + (f" [{of.low:.{digits}f}, {of.high:.{digits}f}]" if np.isfinite(of.low) else "")


def _median(errors: Float[ndarray, "n"], digits: int) -> str:
    known = errors[np.isfinite(errors)]
    return f"{np.median(known):.{digits}f}" if len(known) else "–"


def _share(held: ndarray, clusters: ndarray) -> str:
    if not len(held):
        return "–"
    own = np.unique(clusters, return_inverse=True)[1].astype(np.int64)
    counts, hits = np.bincount(own), np.bincount(own, weights=held)
    value = f"{100 * held.mean():.0f}"
    if len(counts) < 2:
        return value
    drawn = cluster_resamples(own, 1000, 0)
    low, high = np.quantile(100 * (drawn @ hits) / (drawn @ counts), [0.025, 0.975])
    return f"{value} [{low:.0f}, {high:.0f}]"
