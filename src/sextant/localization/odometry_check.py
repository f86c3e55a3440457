r"""Detection of odometry that reports standstill while the images show motion.

A broken encoder, or a topic without a publisher, reports no motion at all. A filter that trusts it stays where the map
is vaguely similar to every observation. Images taken at one place are nearly alike; those of a moving robot differ as
much as images of the map do. Let z be the descriptors of five consecutive images that, according to odometry, were
taken at one place, less than half the spacing of the map and 0.1 rad apart (as a sum of shares of the two), and
:math:`\bar d` the median squared distance between two images of the map. Odometry is contradicted where

.. math:: \operatorname{median}_{i<j} \lVert z_i - z_j \rVert^2 > 0.2\, \bar d .

A single image that differs, such as one of somebody walking past, has no effect: fewer than half of the pairs contain
it. The motion of a robot that is carried is as unknown as with broken odometry. Values of the left side on real walks
and at a station are in results/localization_change.md, "When it is lost".
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Self

import torch
from jaxtyping import Bool, Float32, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose
from sextant.localization.constants import ALIKE, ASIDE, FEW
from sextant.localization.particle_filter import way_moved


@dataclass(frozen=True)
class OdometryCheck:
    """The images taken while odometry reports that the robots of r runs stand still.

    Attributes:
        images: the last five, the newest last.
        since: the reported motion since each; nan where there is no image, or the robot has moved away.

    Example:
        >>> still, nowhere = OdometryCheck.none(1, 6), torch.zeros(1, 3).double()
        >>> for image in torch.eye(6):  # no two of them alike
        ...     still = still.moved(nowhere, spacing=1.0).updated(image[None], torch.tensor([True]))
        >>> still.contradicted(apart=2.0), still.contradicted(apart=20.0)
        (tensor([True]), tensor([False]))
    """

    images: Float32[Tensor, "r 5 d"]
    since: Float64[Tensor, "r 5 3"]

    @classmethod
    def none(cls, runs: int, dimension: int, device: torch.device | None = None) -> Self:
        """The state before the first image."""
        since = torch.full((runs, FEW, 3), torch.nan, dtype=torch.float64, device=device)
        return cls(torch.zeros(runs, FEW, dimension, device=device), since)

    def moved(self, motion: Float64[Tensor, "r 3"], spacing: float) -> Self:
        """The state after a motion; an unknown motion, of nan, drops all images.

        Args:
            motion: dx, dy, dtheta in the robot's frame before the motion.
            spacing: spacing of the map.
        """
        since = se2_compose(self.since, motion[:, None])
        stands = way_moved(since, spacing / 2, ASIDE) < 1
        return type(self)(self.images, since.where(stands[..., None], torch.nan))

    def updated(self, images: Float32[Tensor, "r d"], seen: Bool[Tensor, " r"]) -> Self:
        """The state after one more image, given by its descriptor, of the runs that have ``seen`` one."""
        kept = self._held.to(torch.uint8).argsort(dim=1, stable=True)[
            :, 1:, None
        ]  # gaps come first, and the first goes
        since = torch.cat([self.since.gather(1, kept.expand(-1, -1, 3)), torch.zeros_like(self.since[:, :1])], 1)
        held = torch.cat([self.images.gather(1, kept.expand(-1, -1, images.shape[1])), images[:, None]], 1)
        some = seen[:, None, None]
        return type(self)(torch.where(some, held, self.images), torch.where(some, since, self.since))

    @property
    def _held(self) -> Bool[Tensor, "r 5"]:
        return self.since[..., 0].isfinite()

    def contradicted(self, apart: float) -> Bool[Tensor, " r"]:
        """Whether the images show that the robot moves.

        Args:
            apart: the median squared distance between two images of the map.
        """
        full = self._held.all(1)
        if not apart > 0 or not bool(full.any()):
            return torch.zeros_like(full)
        rows = self.images[full].double()
        differ = [(rows[:, i] - rows[:, j]).square().sum(1) for i, j in combinations(range(FEW), 2)]
        return full.masked_scatter(full, torch.stack(differ, 1).median(1).values > ALIKE * apart)
