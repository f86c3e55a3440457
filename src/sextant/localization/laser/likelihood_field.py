r"""The likelihood-field model of a laser scan.

A beam k of range :math:`z_k` ends at a point of the map that depends on the pose. With :math:`d_k` the distance from
the cell there to the nearest occupied one,

.. math:: \log p(z \mid x) = \beta \sum_k \log\Big(w_{\mathrm{hit}}\, e^{-d_k^2 / 2 \sigma^2}
   + w_{\mathrm{rand}} / z_{\max}\Big)

over the beams that ended within the reach :math:`z_{\max}`; the others are ignored. Ends outside the grid, or farther
than ``max_distance_m`` from everything occupied, have only the random part. Only the end of a beam is looked up, not
the cells along it, so walls in between are ignored: the price of the model's speed and smoothness.

Sources: S. Thrun, W. Burgard & D. Fox, "Probabilistic Robotics", 2005, table 6.3, which multiplies the first part by
:math:`1/(\sqrt{2\pi}\sigma)`; as the model is used for ratios, this amounts to a different ratio of the two weights.
The form above with its defaults (60 beams, weights 0.5 and 0.5, σ = 0.2 m, 2 m) is that of AMCL. Beams are treated as
independent, which they are not: β < 1 tempers the product (P. Pfaff, C. Plagemann & W. Burgard, IROS 2007, on peaked
likelihoods).
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from torch import Tensor

from sextant.compiled import compiled
from sextant.localization.laser.scan_evidence import ScanEvidence, chosen_beams, chosen_ranges
from sextant.ranges import Count, NonNegative, Positive, checked
from sextant.worlds.laser import LaserScanner
from sextant.worlds.occupancy import UNKNOWN, OccupancyGrid


@checked
@dataclass(frozen=True, eq=False)
class LikelihoodField:
    """Scores poses by the distance of the ends of beams from walls.

    Attributes:
        grid: the map.
        scanner: the scanner that the scans come from.
        sigma_m: standard deviation of the distance between a beam's end and the wall it met.
        z_hit: weight of beams that end on a mapped surface; may be 0.
        z_rand: weight of beams that end anywhere.
        max_distance_m: ends farther than this from everything occupied are random.
        beams: number of beams of a scan that are used, evenly spread.
        tempering: exponent β of the product over the beams.
        unknown: whether beams that end in an unknown cell count by their distance as in free cells (``distance``, as in
            AMCL) or are random (``random``).

    Raises:
        ArgumentError: a number is outside its range, or ``unknown`` has another value.

    Example:
        >>> import torch
        >>> grid = OccupancyGrid(np.array([[0, 0, 0, 0, 1]], np.uint8), 0.5, (0.0, -0.25))  # a wall from x = 2 to 2.5 m
        >>> model = LikelihoodField(grid, LaserScanner(beams=1, max_range_m=10.0))
        >>> poses = torch.tensor([[[0.25, 0.0, 0.0], [1.25, 0.0, 0.0]]]).double()
        >>> seen = model.observe(torch.tensor([[2.0]]).double(), poses[0])  # two metres ahead
        >>> seen.log_likelihood(poses).argmax().item()  # which fits the first pose
        0
    """

    grid: OccupancyGrid
    scanner: LaserScanner
    sigma_m: Positive = 0.2
    z_hit: NonNegative = 0.5
    z_rand: Positive = 0.5
    max_distance_m: Positive = 2.0
    beams: Count = 60
    tempering: Positive = 1.0
    unknown: Literal["random", "distance"] = "distance"
    table: Float32[ndarray, "rows columns"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        distance = self.grid.distance_m()
        random = (distance > self.max_distance_m) | ((self.grid.cells == UNKNOWN) & (self.unknown == "random"))
        hit = np.where(random, 0.0, self.z_hit * np.exp(-(distance**2) / (2 * self.sigma_m**2)))
        # the table is relative to a random beam, whose score is added once for each beam
        table = np.log1p(hit * self.scanner.max_range_m / self.z_rand)
        object.__setattr__(self, "table", table.astype(np.float32))

    def observe(self, scans: Float64[Tensor, "r beams"], map_poses: Float64[Tensor, "n 3"]) -> ScanEvidence:
        """The evidence of one scan for each of r runs.

        Args:
            scans: ranges in metres of all the scanner's beams; its maximum range or nan without a return.
            map_poses: poses of a map's images, at which restarts are drawn.

        Raises:
            ArgumentError: scans or poses are not rows.
            ValueError: the number of beams is not the scanner's, or a range is negative.
        """
        chosen = chosen_beams(self.scanner, self.beams)
        ranges = chosen_ranges(scans, self.scanner, chosen)
        ended = np.isfinite(ranges)
        # beams that ended come first in each row, so that the loop over them needs no test
        order = np.argsort(~ended, axis=1, kind="stable")
        counts = ended.sum(axis=1)
        reach = np.take_along_axis(np.where(ended, ranges, 0.0), order, axis=1)
        angles = self.scanner.angles[chosen][order]
        ends = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=-1) / self.grid.resolution_m
        random = counts * np.log(self.z_rand / self.scanner.max_range_m)

        def at(poses: Float64[ndarray, "_ p 3"]) -> Float64[ndarray, "r p"]:
            out = np.empty((len(counts), poses.shape[1]))
            _field_sums(poses, ends, counts, self.table, *self.grid.origin, self.grid.resolution_m, out)
            return np.asarray(self.tempering * (out + random[:, None]))

        return ScanEvidence(at, map_poses, len(counts))


@compiled
def _field_sums(poses, ends, counts, table, left, bottom, resolution, out):  # type: ignore[no-untyped-def]
    """Sums of table entries at the ends of beams.

    Args:
        poses: ``(r, p, 3)``, or ``(1, p, 3)`` for all runs.
        ends: ``(r, k, 2)`` ends of the beams in the scanner's frame, in cells.
        counts: ``(r,)`` number of ends.
        table: ``(rows, columns)``.
        left, bottom: outer corner of the table's first cell in metres.
        resolution: side of a cell in metres.
        out: ``(r, p)``, written.
    """
    rows, columns = table.shape
    shared = poses.shape[0] == 1
    for run in range(len(counts)):
        of = 0 if shared else run
        for number in range(poses.shape[1]):
            x = (poses[of, number, 0] - left) / resolution
            y = (poses[of, number, 1] - bottom) / resolution
            cosine, sine = np.cos(poses[of, number, 2]), np.sin(poses[of, number, 2])
            total = 0.0
            for beam in range(counts[run]):
                ahead, aside = ends[run, beam, 0], ends[run, beam, 1]
                u = x + cosine * ahead - sine * aside
                v = y + sine * ahead + cosine * aside
                if 0.0 <= u < columns and 0.0 <= v < rows:  # false for nan too
                    total += table[int(v), int(u)]
            out[run, number] = total
