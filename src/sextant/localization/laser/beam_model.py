r"""The beam model of a laser scan, which compares each range with the one that the map predicts.

With :math:`z^*` the range at which the beam meets the first occupied cell (at most the reach :math:`z_{\max}`),

.. math:: p(z \mid x) = w_{\mathrm{hit}}\, \eta\, \mathcal N(z; z^*, \sigma^2)
   + w_{\mathrm{short}}\, \frac{\lambda e^{-\lambda z}}{1 - e^{-\lambda z^*}} [z \le z^*]
   + w_{\mathrm{max}}\, [z = z_{\max}] + w_{\mathrm{rand}}\, [z < z_{\max}] / z_{\max}

per metre, with :math:`\eta` the reciprocal of the normal distribution's mass in :math:`[0, z_{\max}]` and weights
divided by their sum. The log-likelihood of a scan is :math:`\beta` times the sum of the logarithms. Where :math:`z^*`
is not known (the beam meets an unknown cell first, or leaves the grid), only the parts that do not need it remain.

Where the map predicts no return (:math:`z^* = z_{\max}`), a beam without a return is a hit. It is then scored as a
range of :math:`z_{\max}`, as in the table.

Source: S. Thrun, W. Burgard & D. Fox, "Probabilistic Robotics", 2005, table 6.1; default weights as in AMCL.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy.special import ndtr
from torch import Tensor

from sextant.localization.laser.ray_casting import free_steps, ray_ranges
from sextant.localization.laser.scan_evidence import ScanEvidence, chosen_beams, chosen_ranges
from sextant.worlds.laser import LaserScanner
from sextant.worlds.occupancy import OccupancyGrid

#: Rays that are cast at a time, which bounds the memory.
BLOCK = 2**18


@dataclass(frozen=True, eq=False)
class BeamModel:
    """Scores poses by casting rays in the map.

    Attributes:
        grid: the map.
        scanner: the scanner that the scans come from.
        z_hit, z_short, z_max, z_rand: weights of beams that end on what the map has, on something before it, nowhere,
            and anywhere.
        sigma_hit: standard deviation of a range in metres.
        lambda_short: rate per metre at which unmapped objects end a beam.
        beams: number of beams of a scan that are used, evenly spread.
        tempering: exponent β of the product over the beams.

    Raises:
        ValueError: ``z_hit`` or ``z_short`` is negative, or another number is not positive.

    Example:
        >>> import torch
        >>> grid = OccupancyGrid(np.array([[0, 0, 0, 0, 1]], np.uint8), 0.5, (0.0, -0.25))  # a wall from x = 2 to 2.5 m
        >>> model = BeamModel(grid, LaserScanner(beams=1, max_range_m=10.0))
        >>> poses = torch.tensor([[[0.25, 0.0, 0.0], [1.25, 0.0, 0.0]]]).double()
        >>> seen = model.observe(torch.tensor([[2.0]]).double(), poses[0])  # two metres ahead
        >>> seen.log_likelihood(poses).argmax().item()  # so it is at the first pose
        0
    """

    grid: OccupancyGrid
    scanner: LaserScanner
    z_hit: float = 0.5
    z_short: float = 0.05
    z_max: float = 0.05
    z_rand: float = 0.5
    sigma_hit: float = 0.2
    lambda_short: float = 0.1
    beams: int = 60
    tempering: float = 1.0
    steps: Float32[ndarray, "rows columns"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positive = (self.z_max, self.z_rand, self.sigma_hit, self.lambda_short, self.beams, self.tempering)
        if not all(0 < number < np.inf for number in positive) or min(self.z_hit, self.z_short) < 0:
            raise ValueError(
                f"z_max, z_rand, sigma_hit, lambda_short, beams and tempering must be positive, got {positive}, "
                f"and z_hit={self.z_hit} and z_short={self.z_short} not negative"
            )
        object.__setattr__(self, "steps", free_steps(self.grid))

    def observe(self, scans: Float64[Tensor, "r beams"], map_poses: Float64[Tensor, "n 3"]) -> ScanEvidence:
        """The evidence of one scan for each of r runs.

        Args:
            scans: ranges in metres of all the scanner's beams; its maximum range or nan where nothing came back.
            map_poses: poses of a map's images, at which restarts are drawn.

        Raises:
            ValueError: the number of beams is not the scanner's, or a range is negative.
        """
        chosen = chosen_beams(self.scanner, self.beams)
        ranges = chosen_ranges(scans, self.scanner, chosen)
        angles = self.scanner.angles[chosen]

        def at(poses: Float64[ndarray, "_ p 3"]) -> Float64[ndarray, "r p"]:
            out = np.empty((len(ranges), poses.shape[1]))
            per_block = max(1, BLOCK // len(angles))
            for start in range(0, poses.shape[1], per_block):
                some = slice(start, start + per_block)
                for run, measured in enumerate(ranges):
                    if run == 0 or len(poses) > 1:
                        seen = ray_ranges(
                            self.grid, self.steps, poses[min(run, len(poses) - 1), some], angles, self.reach
                        )
                    out[run, some] = self.tempering * np.log(self.density(measured, seen)).sum(axis=1)
            return out

        return ScanEvidence(at, map_poses)

    @property
    def reach(self) -> float:
        """The scanner's maximum range in metres."""
        return self.scanner.max_range_m

    def density(self, measured: Float64[ndarray, " k"], expected: Float64[ndarray, "n k"]) -> Float64[ndarray, "n k"]:
        """Density of each measured range per metre, given the expected ones.

        Args:
            measured: ranges in metres; inf where nothing came back.
            expected: ranges in metres; the reach where nothing should come back, nan where they are not known.
        """
        total = self.z_hit + self.z_short + self.z_max + self.z_rand
        missing = np.isinf(measured)
        z = np.where(missing, self.reach, measured)
        known = np.isfinite(expected)
        # no range is known better than a cell; in a wall it would be 0, and the density of the short part infinite
        wanted = np.maximum(np.where(known, expected, self.reach), self.grid.resolution_m / 2)
        mass = ndtr((self.reach - wanted) / self.sigma_hit) - ndtr(-wanted / self.sigma_hit)
        hit = np.exp(-(((z - wanted) / self.sigma_hit) ** 2) / 2) / (np.sqrt(2 * np.pi) * self.sigma_hit * mass)
        short = self.lambda_short * np.exp(-self.lambda_short * z) / -np.expm1(-self.lambda_short * wanted)
        depends = np.where(known, self.z_hit * hit + np.where(z <= wanted, self.z_short * short, 0.0), 0.0)
        alone = np.where(missing, self.z_max, self.z_rand / self.reach)
        return np.asarray((depends + alone) / total)
