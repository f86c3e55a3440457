r"""The scale of a network's spreads, fitted to photos with known cameras, and its file.

With errors e and standard errors s of a number, the scale T maximises the likelihood of the loss that the network has
among all evidence, Student's t with :math:`\nu = 3` degrees of freedom:

.. math:: \sum_i w_i \left[ \log T + \tfrac{\nu + 1}{2} \log\left(1 + \frac{e_i^2}{\nu T^2 s_i^2}\right) \right] ,

where the photos of one source have the weight of the root of their number in all.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.optimize import minimize_scalar

from sextant.atomic_files import read_json, write_json
from sextant.baselines.calibration import CameraBelief
from sextant.chapters.calibration.finding import STUDENT
from sextant.chapters.calibration.metrics.photo_benchmark import Answers, Table, Truth
from sextant.errors import UserError

NUMBERS = ("tilt", "roll", "vfov", "k1_hat")
#: ends of the search; fewest photos with a known number for a scale, below which it stays 1
LEAST, MOST, FEWEST = 1e-3, 1e3, 8


@dataclass(frozen=True, eq=False)
class NetworkScale:
    """The scales of a network's standard errors.

    Attributes:
        values: of tilt, roll, vfov and k1_hat; 1 where too few photos have a known value.
        photos: the number of photos behind each.
        coverage: by level, the share of errors inside the interval before and after, each by scales that were fitted
            without the photo's source; nan with one source.
    """

    values: tuple[float, float, float, float]
    photos: tuple[int, ...]
    coverage: Mapping[str, tuple[tuple[float, float], ...]]

    def table(self) -> Table:
        """Scales and coverage by number.

        >>> NetworkScale((2.0,) * 4, (9,) * 4, {level: ((0.5, 0.7),) * 4 for level in STUDENT}).table()[1][0]
        ['tilt', '9', '2.00', '50 to 70', '50 to 70']
        """
        titles = ["number", "photos", "scale", *(f"inside {level} %, before to after" for level in STUDENT)]
        rows = [
            [name, str(self.photos[k]), f"{self.values[k]:.2f}"]
            + [" to ".join(_percent(share) for share in self.coverage[level][k]) for level in STUDENT]
            for k, name in enumerate(NUMBERS)
        ]
        return titles, rows


def fit_scale(truth: Truth, answers: Answers) -> NetworkScale:
    """The scales by a network's estimates for photos with known cameras.

    Args:
        truth: the known cameras.
        answers: the network's, with half-widths by :data:`~sextant.chapters.calibration.finding.STUDENT`.

    >>> rng = np.random.default_rng(0)
    >>> truth = Truth(np.array([[0.0, 0.0, 1.0, 0.0]] * 4000), np.ones(4000), [str(i % 20) for i in range(4000)])
    >>> said = truth.cameras + [0.1, 0, 0, 0] * rng.standard_t(3, (4000, 4))
    >>> found = fit_scale(truth, Answers(said, {"68": np.full((4000, 4), 0.05 * STUDENT["68"])}, []))
    >>> round(found.values[0], 1)  # its errors are twice as large as it says
    2.0
    """
    ratios, sources = np.abs(_numbers(answers.cameras) - _numbers(truth.cameras)) / _sigmas(answers), truth.clusters
    ratios[np.isinf(answers.half["68"])] = np.nan
    values, photos = [], []
    coverage = dict[str, list[tuple[float, float]]]({level: [] for level in STUDENT})
    for column in ratios.T:
        known = np.isfinite(column)
        own, owners = column[known], np.array(sources, dtype=str)[known]
        photos.append(len(own))
        values.append(_scale(own, owners))
        others = np.ones(len(own))
        for owner in np.unique(owners):
            others[owners == owner] = _scale(own[owners != owner], owners[owners != owner])
        for level, bound in STUDENT.items():
            after = np.mean(own <= bound * others) if len(np.unique(owners)) > 1 else np.nan
            coverage[level].append((float(np.mean(own <= bound)) if len(own) else np.nan, float(after)))
    tilt, roll, vfov, k1_hat = values
    return NetworkScale((tilt, roll, vfov, k1_hat), tuple(photos), {k: tuple(v) for k, v in coverage.items()})


def write_scale(path: Path, scale: NetworkScale, card: Mapping[str, Any], folder: Path) -> None:
    """Write the scales with the network that they belong to.

    Raises:
        OSError: the disk is full.
    """
    about = {key: card[key] for key in ("kind", "file", "sha256") if key in card}
    rows = dict(zip(NUMBERS, scale.values, strict=True))
    write_json(path, {"network": about, "folder": folder.name, "photos": list(scale.photos), "scale": rows})


def read_scale(path: Path, card: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """The scales in a file.

    Raises:
        UserError: it is missing, no such file, or of another network.
    """
    fix = "sextant benchmark calibration network=<network> folder=<photos> writes it."
    content: Any = read_json(path) if path.is_file() else None
    scale = content.get("scale") if isinstance(content, Mapping) else None
    numbers: list[Any] = [scale.get(name) for name in NUMBERS] if isinstance(scale, Mapping) else []
    if len(numbers) != 4 or not all(isinstance(n, int | float) and math.isfinite(n) and n > 0 for n in numbers):
        raise UserError(f"scale={path} is not a file of the scales of a network", fix)
    about = content.get("network")
    if not isinstance(about, Mapping) or about.get("sha256") != card.get("sha256"):
        named = about.get("file", "another network") if isinstance(about, Mapping) else "another network"
        raise UserError(f"scale={path} was fitted for {named}, not for {card.get('file', 'this network')}", fix)
    tilt, roll, vfov, k1_hat = map(float, numbers)
    return tilt, roll, vfov, k1_hat


def _sigmas(answers: Answers) -> Float64[ndarray, "n 4"]:
    return answers.half["68"] / STUDENT["68"]


def _numbers(cameras: Float64[ndarray, "n 4"]) -> Float64[ndarray, "n 4"]:
    focal = cameras[:, 2]
    return np.column_stack([cameras[:, 0], cameras[:, 1], 2 * np.arctan(0.5 / focal), cameras[:, 3] / focal**2])


def _scale(ratios: Float64[ndarray, "n"], sources: ndarray) -> float:
    if len(ratios) < FEWEST:
        return 1.0
    _, own, counts = np.unique(sources, return_inverse=True, return_counts=True)
    weights, nu = counts[own] ** -0.5, CameraBelief.nu

    def cost(log_scale: float) -> float:
        squares = np.square(ratios / math.exp(log_scale))
        return float(weights @ (log_scale + (nu + 1) / 2 * np.log1p(squares / nu)))

    return math.exp(minimize_scalar(cost, bounds=(math.log(LEAST), math.log(MOST)), method="bounded").x)


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if math.isfinite(share) else "–"
