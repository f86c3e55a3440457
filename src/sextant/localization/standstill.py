r"""Whether odometry says that a robot stands while its images say that it moves.

A broken encoder, or a topic that nobody publishes, reads as no motion at all, and a filter that believes it stays where
images look a little like everything that is seen. Images taken at one place are nearly alike; those of a robot that
moves are as different as images of the map are. With z the descriptors of six images in a row that odometry has taken
within half a step from one image of the map to the next and 0.1 rad, and :math:`\bar d` the squared distance between
any two images of the map (the median), odometry is contradicted where

.. math:: \operatorname{median}_{i<j} \lVert z_i - z_j \rVert^2 > 0.2\, \bar d .

A single image that differs, of somebody who walks past, does not count: fewer than half of the pairs have it. Where a
robot is carried the motion is as unknown as where odometry is broken. On the walks of docs/localization_change.md,
"When it is lost", the left side is 0.00 to 0.03 of :math:`\bar d` where a train stands, and 0.3 and more where anything
moves.
"""

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose
from sextant.localization.particle_filter import way_moved

#: images that are compared
COMPARED = 6
#: of a robot that stands, all are within so many steps from one image of the map to the next, or rad
STANDS, TURNS = 0.5, 0.1
#: squared distances beyond this share of those between images of the map are of a robot that moves
ALIKE = 0.2


@dataclass(frozen=True)
class Standstill:
    """The images taken where odometry says that a robot stands.

    Attributes:
        images: the last six at most, each with the motion told since.

    Example:
        >>> still, nowhere = Standstill(), torch.zeros(3, dtype=torch.float64)
        >>> for image in torch.eye(6):  # no two of them alike
        ...     still = still.moved(nowhere, spacing=1.0).seen(image)
        >>> still.contradicted(apart=2.0), still.contradicted(apart=20.0)
        (True, False)
    """

    images: tuple[tuple[Float64[Tensor, "3"], Float[Tensor, " d"]], ...] = ()

    def moved(self, motion: Float64[Tensor, "3"], spacing: float) -> Self:
        """With a motion; an unknown one, of nan, forgets all images.

        Args:
            motion: dx, dy, dtheta in the robot's frame before.
            spacing: of the map.
        """
        told = ((se2_compose(since, motion), image) for since, image in self.images)
        return type(self)(tuple(each for each in told if float(way_moved(each[0], STANDS * spacing, TURNS)) < 1))

    def seen(self, image: Float[Tensor, " d"]) -> Self:
        """With an image, described."""
        here = torch.zeros(3, dtype=torch.float64)
        return type(self)((*self.images[-(COMPARED - 1) :], (here, image)))

    def contradicted(self, apart: float) -> bool:
        """Whether the images are of a robot that moves.

        Args:
            apart: the squared distance between any two images of the map.
        """
        if len(self.images) < COMPARED or not apart > 0:
            return False
        rows = torch.stack([image for _, image in self.images]).double()
        return float(torch.pdist(rows).square().median()) > ALIKE * apart
