"""The evidence of a laser scan about the pose of each of several runs."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray
from torch import Tensor

from sextant.localization.observation.evidence import Evidence, check_runs
from sextant.shapes import check_shape
from sextant.worlds.laser import LaserScanner

#: Log-likelihoods ``(r, p)`` of the scans of r runs at poses ``(r, p, 3)``, or ``(1, p, 3)`` that all runs share.
AtPoses = Callable[[Float64[ndarray, "_ p 3"]], Float64[ndarray, "r p"]]


class ScanEvidence(Evidence):
    """Log-likelihoods of one scan in each of r runs.

    Args:
        at: function that gives the scans' log-likelihoods at poses.
        map_poses: poses of the images of a visual map, at which `over_map` computes log-likelihoods.
        runs: r; None: the poses are not checked.

    Raises:
        ArgumentError: ``map_poses`` are not rows of x, y and heading.
    """

    def __init__(self, at: AtPoses, map_poses: Float64[Tensor, "n 3"], runs: int | None = None):
        check_shape("map_poses", map_poses, "n", 3)
        self._at, self._map_poses, self._runs = at, map_poses, runs

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """The log-likelihood of each run's scan at poses of its own."""
        if self._runs is not None:  # machine code would read past the last run
            check_runs(poses, self._runs, "scan")
        return torch.from_numpy(self._at(np.ascontiguousarray(poses.detach().numpy())))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """The log-likelihood of each run's scan at the poses of the map's images."""
        return torch.from_numpy(self._at(np.ascontiguousarray(self._map_poses.detach().numpy())[None]))


def chosen_beams(scanner: LaserScanner, beams: int) -> Int64[ndarray, " k"]:
    """Indices of ``beams`` evenly spread beams of the scanner; all of them if it has no more.

    In a scanner that covers a full turn, the last chosen beam is as far from the first as from its other neighbour.

    Raises:
        ValueError: ``beams`` is not positive.
    """
    if beams < 1:
        raise ValueError(f"beams={beams} must be positive")
    if beams >= scanner.beams:
        return np.arange(scanner.beams)
    full = scanner.field_of_view_rad >= 2 * np.pi * (1 - 1e-12)
    if full or beams == 1:  # a single beam points straight ahead, the middle of its share
        return ((np.arange(beams) + (0.0 if full else 0.5)) * scanner.beams / beams).astype(np.int64)
    return np.round(np.linspace(0, scanner.beams - 1, beams)).astype(np.int64)


def chosen_ranges(
    scans: Float64[Tensor, "r beams"], scanner: LaserScanner, chosen: Int64[ndarray, " k"]
) -> Float64[ndarray, "r k"]:
    """Ranges of the chosen beams in metres; inf without a return: at least the maximum range, or nan.

    Raises:
        ArgumentError: scans are not one row for each run.
        ValueError: scans have a different number of beams than the scanner, or a range is negative.
    """
    check_shape("scans", scans, "runs", "beams")
    if scans.shape[-1] != scanner.beams:
        raise ValueError(f"scans have {scans.shape[-1]} beams, the scanner has {scanner.beams}")
    ranges = scans.detach().numpy()[:, chosen]
    if (ranges < 0).any():
        raise ValueError("a range is negative")
    # scans are kept in float32, in which the reach may be rounded down
    reach = min(scanner.max_range_m, float(np.float32(scanner.max_range_m)))
    return np.where(ranges < reach, ranges, np.inf)
