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
from scipy import ndimage
from scipy.special import ndtr
from torch import Tensor

from sextant.compiled import compiled
from sextant.localization.laser.scan_evidence import ScanEvidence, chosen_beams, chosen_ranges
from sextant.ranges import Count, NonNegative, Positive, checked
from sextant.worlds.laser import LaserScanner
from sextant.worlds.occupancy import FREE, OccupancyGrid


def free_steps(grid: OccupancyGrid) -> Float32[ndarray, "rows columns"]:
    r"""The number of cells that a ray may skip from anywhere in each cell without meeting one that is not free.

    A ray visits the cells on its way one by one (J. Amanatides & A. Woo, "A fast voxel traversal algorithm for ray
    tracing", Eurographics 1987) and ends in the first that is not free. Where the centre of the nearest such cell is
    :math:`d` cells away from that of the ray's own cell, no point of it is nearer than :math:`d - \sqrt 2` to the ray.
    The ray skips that far, which gives the same result in fewer steps.

    A surface lies somewhere in the occupied cell, so its distance is taken to be that of the midpoint of the ray's path
    through the cell. Rays that meet an unknown cell first, or leave the grid, have no known range (nan). Rays that
    reach the maximum range in free cells end there.
    """
    free = grid.cells == FREE
    if free.all():
        # no cell ends a ray: only the border of the grid does, and the traversal finds it
        return np.zeros(free.shape, np.float32)
    distance = ndimage.distance_transform_edt(free)
    return np.asarray(np.maximum(distance - np.sqrt(2), 0.0), np.float32)


def ray_ranges(
    grid: OccupancyGrid,
    steps: Float32[ndarray, "rows columns"],
    poses: Float64[ndarray, "n 3"],
    angles: Float64[ndarray, " k"],
    max_range_m: float,
) -> Float64[ndarray, "n k"]:
    """Distance in metres from each pose to the first occupied cell along each beam; nan where it is not known.

    Args:
        grid: the map.
        steps: result of `free_steps`.
        poses: x, y in metres and heading in radians.
        angles: angles of the beams from the heading in radians.
        max_range_m: reach, the largest distance returned.
    """
    out = np.empty((len(poses), len(angles)))
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    _cast(poses, beams, grid.cells, steps, *grid.origin, grid.resolution_m, max_range_m, out)
    return out


@compiled
def _cast(poses, beams, cells, steps, left, bottom, resolution, reach_m, out):  # type: ignore[no-untyped-def]
    """Write ranges ``(n, k)`` in metres; see `ray_ranges`. Lengths inside the function are in cells."""
    rows, columns = cells.shape
    reach = reach_m / resolution
    for number in range(len(poses)):
        x, y = (poses[number, 0] - left) / resolution, (poses[number, 1] - bottom) / resolution
        cosine, sine = np.cos(poses[number, 2]), np.sin(poses[number, 2])
        for beam in range(len(beams)):
            dx = cosine * beams[beam, 0] - sine * beams[beam, 1]
            dy = sine * beams[beam, 0] + cosine * beams[beam, 1]
            out[number, beam] = np.nan
            if not (0.0 <= x < columns and 0.0 <= y < rows):  # true for nan too
                continue
            # a ray along an axis never leaves through the sides it runs parallel to
            per_x, ahead_x = (1 / dx, dx > 0) if dx != 0 else (np.inf, 2)
            per_y, ahead_y = (1 / dy, dy > 0) if dy != 0 else (np.inf, 2)
            column, row, travelled = int(x), int(y), 0.0
            while 0 <= column < columns and 0 <= row < rows:
                # where the ray leaves the cell, computed from whole numbers so that rounding does not accumulate
                to_x = (column + ahead_x - x) * per_x
                to_y = (row + ahead_y - y) * per_y
                leaves = max(min(to_x, to_y), travelled)
                if cells[row, column] != 0:
                    if cells[row, column] == 1:
                        out[number, beam] = min((travelled + leaves) / 2, reach) * resolution
                    break
                skip = travelled + steps[row, column]
                if skip > leaves:
                    travelled = skip
                    column, row = int(np.floor(x + travelled * dx)), int(np.floor(y + travelled * dy))
                else:
                    travelled = leaves
                    if to_x < to_y:
                        column += 1 if dx > 0 else -1
                    else:
                        row += 1 if dy > 0 else -1
                if travelled >= reach:
                    if 0 <= x + reach * dx <= columns and 0 <= y + reach * dy <= rows:  # not skipped out of the grid
                        out[number, beam] = reach_m
                    break


#: Rays that are cast at a time, which bounds the memory.
BLOCK = 2**18


@checked
@dataclass(frozen=True, eq=False)
class BeamModel:
    """Scores poses by casting rays in the map.

    Attributes:
        grid: the map.
        scanner: the scanner that the scans come from.
        z_hit, z_short, z_max, z_rand: weights of beams that end on a mapped surface, on an unmapped object before it,
            nowhere, and anywhere; the first two may be 0.
        sigma_hit: standard deviation of a range in metres.
        lambda_short: rate per metre at which unmapped objects end a beam.
        beams: number of beams of a scan that are used, evenly spread.
        tempering: exponent β of the product over the beams.

    Raises:
        ArgumentError: a number is outside its range.

    Example:
        >>> import torch
        >>> grid = OccupancyGrid(np.array([[0, 0, 0, 0, 1]], np.uint8), 0.5, (0.0, -0.25))  # a wall from x = 2 to 2.5 m
        >>> model = BeamModel(grid, LaserScanner(beams=1, max_range_m=10.0))
        >>> poses = torch.tensor([[[0.25, 0.0, 0.0], [1.25, 0.0, 0.0]]]).double()
        >>> seen = model.observe(torch.tensor([[2.0]]).double(), poses[0])  # two metres ahead
        >>> seen.log_likelihood(poses).argmax().item()  # which fits the first pose
        0
    """

    grid: OccupancyGrid
    scanner: LaserScanner
    z_hit: NonNegative = 0.5
    z_short: NonNegative = 0.05
    z_max: Positive = 0.05
    z_rand: Positive = 0.5
    sigma_hit: Positive = 0.2
    lambda_short: Positive = 0.1
    beams: Count = 60
    tempering: Positive = 1.0
    steps: Float32[ndarray, "rows columns"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", free_steps(self.grid))

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

        return ScanEvidence(at, map_poses, len(ranges))

    @property
    def reach(self) -> float:
        """The scanner's maximum range in metres."""
        return self.scanner.max_range_m

    def density(self, measured: Float64[ndarray, " k"], expected: Float64[ndarray, "n k"]) -> Float64[ndarray, "n k"]:
        """Density of each measured range per metre, given the expected ones.

        Args:
            measured: ranges in metres; inf without a return.
            expected: ranges in metres; the reach where no return is expected, nan where they are unknown.
        """
        total = self.z_hit + self.z_short + self.z_max + self.z_rand
        missing = np.isinf(measured)
        z = np.where(missing, self.reach, measured)
        known = np.isfinite(expected)
        # ranges are no finer than a cell; in a wall it would be 0, and the density of the short part infinite
        wanted = np.maximum(np.where(known, expected, self.reach), self.grid.resolution_m / 2)
        mass = ndtr((self.reach - wanted) / self.sigma_hit) - ndtr(-wanted / self.sigma_hit)
        hit = np.exp(-(((z - wanted) / self.sigma_hit) ** 2) / 2) / (np.sqrt(2 * np.pi) * self.sigma_hit * mass)
        short = self.lambda_short * np.exp(-self.lambda_short * z) / -np.expm1(-self.lambda_short * wanted)
        depends = np.where(known, self.z_hit * hit + np.where(z <= wanted, self.z_short * short, 0.0), 0.0)
        alone = np.where(missing, self.z_max, self.z_rand / self.reach)
        return np.asarray((depends + alone) / total)
