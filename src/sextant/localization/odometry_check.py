r"""Detection of odometry that reports standstill while the images show motion.

A broken encoder, or a topic without a publisher, reports no motion at all. A filter that trusts it stays where the map
is vaguely similar to every observation. Images taken at one place are nearly alike; those of a moving robot differ as
much as images of the map do. Let z be the descriptors of six consecutive images that, according to odometry, were taken
at one place, less than half the spacing of the map and 0.1 rad apart (as a sum of shares of the two), and
:math:`\bar d` the median squared distance between two images of the map. Odometry is contradicted where

.. math:: \operatorname{median}_{i<j} \lVert z_i - z_j \rVert^2 > 0.2\, \bar d .

A single image that differs, such as one of somebody walking past, has no effect: fewer than half of the pairs contain
it. The motion of a robot that is carried is as unknown as with broken odometry. Values of the left side on real walks
and at a station are in results/localization_change.md, "When it is lost".
"""

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose
from sextant.localization.particle_filter import way_moved

#: number of images that are compared
COMPARED = 6
#: images of a robot that stands still are within this many spacings of the map, and rad
STANDS, TURNS = 0.5, 0.1
#: squared distances above this share of those between images of the map show that the robot moves
ALIKE = 0.2


@dataclass(frozen=True)
class OdometryCheck:
    """The images taken while odometry reports that the robot stands still.

    Attributes:
        images: at most the last six, each with the reported motion since then.

    Example:
        >>> still, nowhere = OdometryCheck(), torch.zeros(3, dtype=torch.float64)
        >>> for image in torch.eye(6):  # no two of them alike
        ...     still = still.moved(nowhere, spacing=1.0).updated(image)
        >>> still.contradicted(apart=2.0), still.contradicted(apart=20.0)
        (True, False)
    """

    images: tuple[tuple[Float64[Tensor, "3"], Float[Tensor, " d"]], ...] = ()

    def moved(self, motion: Float64[Tensor, "3"], spacing: float) -> Self:
        """The state after a motion; an unknown motion, of nan, drops all images.

        Args:
            motion: dx, dy, dtheta in the robot's frame before the motion.
            spacing: spacing of the map.
        """
        told = ((se2_compose(since, motion), image) for since, image in self.images)
        return type(self)(tuple(each for each in told if float(way_moved(each[0], STANDS * spacing, TURNS)) < 1))

    def updated(self, image: Float[Tensor, " d"]) -> Self:
        """The state after one more image, given by its descriptor."""
        here = torch.zeros(3, dtype=torch.float64)
        return type(self)((*self.images[-(COMPARED - 1) :], (here, image)))

    def contradicted(self, apart: float) -> bool:
        """Whether the images show that the robot moves.

        Args:
            apart: the median squared distance between two images of the map.
        """
        if len(self.images) < COMPARED or not apart > 0:
            return False
        rows = torch.stack([image for _, image in self.images]).double()
        return float(torch.pdist(rows).square().median()) > ALIKE * apart
