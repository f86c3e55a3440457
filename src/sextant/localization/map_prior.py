r"""The prior over poses before the first observation: near an image of the map, all images being equally likely.

.. math:: p_0(x) = \frac1N \sum_{i=1}^N p(x \mid i), \qquad
   x = x_i \circ (\epsilon_x, \epsilon_y, \epsilon_\theta), \quad \epsilon \sim \mathcal N(0, \mathrm{diag}(\sigma^2))

with the offset in the frame of the image: along its heading, across it, and in heading. It replaces a uniform density
over the map's bounding box, most of which may be inaccessible.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import UserError, shown
from sextant.geometry.planar import se2_compose
from sextant.localization.descriptor_map import check_finite
from sextant.ranges import NonNegative, fits
from sextant.shapes import check_shape

#: smallest spacing: positions nearer to each other are taken to be this far apart
LEAST_SPACING = 1e-6


@dataclass(frozen=True)
class MapPrior:
    """A uniform prior over the map's images, with jitter.

    Attributes:
        poses: poses of the images.
        position_sigma: standard deviation in metres, one number or (along, across); on a railway the second is 0.
        heading_sigma_rad: standard deviation of the heading.

    Raises:
        UserError: there is no pose, one is not three finite numbers, or a deviation is negative or not finite.

    Example:
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
        >>> railway = MapPrior(line, position_sigma=(0.5, 0.0), heading_sigma_rad=0.0)
        >>> drawn = railway.sample(runs=2, particles=1000, generator=torch.Generator().manual_seed(0))
        >>> drawn.shape, drawn.abs().amax((0, 1))[1:].tolist()  # along the line only
        (torch.Size([2, 1000, 3]), [0.0, 0.0])
    """

    poses: Float64[Tensor, "n 3"]
    position_sigma: float | tuple[float, float]
    heading_sigma_rad: float

    def __post_init__(self) -> None:
        check_shape("poses", self.poses, "n", 3)
        if len(self.poses) == 0:
            raise UserError("the map has no image", "Provide images with known poses.")
        check_finite(self.poses)
        position, heading = self.position_sigma, self.heading_sigma_rad
        if not (fits(NonNegative | tuple[NonNegative, NonNegative], position) and fits(NonNegative, heading)):
            raise UserError(
                f"position_sigma={shown(position)}, one number or two, and heading_sigma_rad={shown(heading)} "
                "must be finite and not negative",
                "For example half the distance between images of the map.",
            )

    @property
    def sigmas(self) -> tuple[float, float, float]:
        """Standard deviations along and across the heading, and of the heading itself."""
        along, across = np.broadcast_to(self.position_sigma, 2)
        return float(along), float(across), float(self.heading_sigma_rad)

    def sample(self, runs: int, particles: int, generator: torch.Generator) -> Float64[Tensor, "r p 3"]:
        """Independent draws of :math:`p_0`."""
        rows = torch.randint(
            len(self.poses), (runs, particles), generator=generator, device=self.poses.device, dtype=torch.int64
        )
        return self.around(rows, generator)

    def around(self, rows: Int64[Tensor, "r k"], generator: torch.Generator) -> Float64[Tensor, "r k 3"]:
        """A draw of :math:`p(x | i)` for each row i of the map."""
        poses = self.poses[rows]
        noise = torch.randn(poses.shape, generator=generator, dtype=poses.dtype, device=poses.device)
        return se2_compose(poses, noise * poses.new_tensor(self.sigmas))


def half_spacing(poses: Float64[Tensor, "n 3"]) -> float:
    """Half the median distance from a position of a map to the nearest other one: the width of a prior without gaps.

    Images at one position count once; a map of one position gives 0.5.

    Example:
        >>> half_spacing(torch.tensor([[0.0, 0, 0], [0, 0, 3], [2, 0, 0], [4, 0, 0]], dtype=torch.float64))
        1.0
    """
    positions = np.unique(poses[:, :2].numpy(), axis=0)
    apart = cKDTree(positions).query(positions, k=[2])[0][:, 0] if len(positions) > 1 else np.ones(1)
    return max(float(np.median(apart)), LEAST_SPACING) / 2
