r"""Whether images show places of the map at all, by comparison with the map's own images in a map of other places.

Some place of a map is always the most similar, even in another building. The null distribution of images of *unknown*
places is estimated from the map itself: each of its images is compared with those of other places only. Let y be
descriptors of the map with mean m, z that of an image, and z' the latter with the change common to the drive removed
(:class:`~sextant.localization.appearance_change.AppearanceChange`). Three statistics indicate that an image is of the
map:

.. math:: -\min_i \|z - y_i\|^2, \qquad
   c_j - \max_{k \notin \mathcal P_j} c_k, \qquad
   -\operatorname{median}_{i \in \mathcal T} \|p_i - p_j\|, \qquad
   c_i = \frac{(z' - m)^\top (y_i - m)}{\|z' - m\| \, \|y_i - m\|},

the nearness of the most similar image; the margin of the most similar place j over any other, where
:math:`\mathcal P_j` are the images within 4.5 spacings of it (two places of 2.5 spacings that overlap by half of one or
more); and the nearness to it of the five most similar images :math:`\mathcal T`. An image's *recognition* is the mean,
over the three, of the share of the map's own images with a lower value in the map of other places: 1/2 on average for
one more image of an unknown place, more for a known place, and less in a world that is less similar to the map than the
map's places are to each other.

The mean over all images of a drive tells whether the drive as a whole shows this map's place
(:meth:`MapRecognition.of_drive`).

It needs no motion, so it applies where :mod:`~sextant.localization.innovation_test` does not: to photos and videos
without odometry. Ranks of an image in a sample of the null hypothesis, as shares, are p-values of a conformal test (V.
Vovk, A. Gammerman, G. Shafer, "Algorithmic Learning in a Random World", 2005, section 2.2). The constants were chosen
on the walks of results/localization_change.md, "When it is lost".
"""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64
from torch import Tensor

from sextant.localization.constants import FEW, PLACE, WINDOW
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.map_support import map_spacing

#: evenly chosen images of the map for the null distribution; with fewer than ``WINDOW`` there is no verdict
MOST = 256
#: similarities held at a time
BLOCK = 2**24


@dataclass(frozen=True, eq=False)
class MapRecognition:
    """The null distribution of images of places that are not in the map.

    Attributes:
        map: the map.
        norms: lengths of its centred descriptors.
        unknown: the three statistics of its own images in the map of other places, each sorted.

    Example:
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(40)], dtype=torch.float64)
        >>> draws = torch.Generator().manual_seed(0)
        >>> places = DescriptorMap.of(poses, torch.randn(40, 16, generator=draws))
        >>> images = torch.stack([places.descriptors[7], 3 * torch.ones(16)])
        >>> centred = torch.stack([places.descriptors[7], torch.ones(16)])
        >>> MapRecognition.of(places).share(images, centred).round(decimals=2).tolist()  # here, and elsewhere
        [0.87, 0.54]
    """

    map: DescriptorMap
    spacing: float
    norms: Float32[Tensor, " n"]
    unknown: Float64[Tensor, "3 m"]

    @classmethod
    def of(cls, found: DescriptorMap) -> Self | None:
        """The null distribution of a map; None if its images are of too few places."""
        norms = (found.descriptors - found.mean).norm(dim=1).clamp(min=1e-12)
        empty = cls(found, map_spacing(found.poses), norms, found.poses.new_empty(3, 0))
        count = min(len(found), max(BLOCK * 4 // len(found), 3 * WINDOW), MOST)
        rows = torch.from_numpy(np.unique(np.linspace(0, len(found) - 1, count).astype(np.int64)))
        parts = []
        for some in rows.split(max(1, BLOCK // len(found))):
            own = found.descriptors[some]
            parts.append(empty._numbers(own, own, empty._beyond(some)))
        unknown = torch.cat(parts, 1)
        unknown = unknown[:, unknown.isfinite().all(0)].sort(1).values
        return cls(found, empty.spacing, norms, unknown) if unknown.shape[1] >= WINDOW else None

    def share(self, descriptors: Float32[Tensor, "r d"], centred: Float32[Tensor, "r d"]) -> Float64[Tensor, " r"]:
        """The recognition of images, in [0, 1]; nan if one of their statistics is not finite.

        Args:
            descriptors: their descriptors z.
            centred: z', without the change common to the drive.
        """
        found = self._numbers(descriptors, centred, None)
        sides = torch.searchsorted(self.unknown, found) + torch.searchsorted(self.unknown, found, right=True)
        mean = sides.double().mean(0) / (2 * self.unknown.shape[1])
        return torch.where(found.isfinite().all(0), mean, torch.nan)

    def of_drive(self, descriptors: Float32[Tensor, "r d"]) -> float:
        """The mean recognition of all images of a drive; nan for fewer than five.

        Args:
            descriptors: their descriptors z, in any order.

        Example:
            >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(40)], dtype=torch.float64)
            >>> world = torch.randn(120, 16, generator=torch.Generator().manual_seed(0))
            >>> places = MapRecognition.of(DescriptorMap.of(poses, world[:40]))
            >>> again, elsewhere = world[:40] + 0.2, 3 * world[40:]
            >>> round(places.of_drive(again), 2), round(places.of_drive(elsewhere), 2)
            (0.85, 0.37)
        """
        count = len(descriptors)
        if count < FEW:
            return math.nan
        changed = count / (count + FEW) * (descriptors.mean(0) - self.map.mean)  # as an AppearanceChange after them
        return float(self.share(descriptors, descriptors - changed).nanmean())

    def _beyond(self, rows: Tensor) -> Bool[Tensor, "r n"]:
        """Which images show other places than those in the given rows of the map."""
        positions = self.map.poses[:, :2]
        return torch.cdist(positions[rows], positions) > (2 * PLACE - 0.5) * self.spacing

    def _numbers(
        self, seen: Float32[Tensor, "r d"], centred: Float32[Tensor, "r d"], among: Bool[Tensor, "r n"] | None
    ) -> Float64[Tensor, "3 r"]:
        """The three statistics of descriptors in the map, or in those of its images that are in ``among``."""
        mapped, mean, positions = self.map.descriptors, self.map.mean, self.map.poses[:, :2]
        apart = (mapped.square().sum(1) - 2 * seen @ mapped.T).add(seen.square().sum(1, keepdim=True))
        about = centred - mean
        alike = about @ mapped.T - (about @ mean)[:, None]
        alike = alike / self.norms / about.norm(dim=1, keepdim=True)
        if among is not None:
            apart, alike = apart.masked_fill(~among, torch.inf), alike.masked_fill(~among, -torch.inf)
        alike = alike.nan_to_num(-torch.inf, neginf=-torch.inf)
        best, rows = alike.topk(min(FEW, alike.shape[1]), dim=1)
        other = alike.masked_fill(~self._beyond(rows[:, 0]), -torch.inf).amax(1)
        spread = (positions[rows] - positions[rows[:, :1]]).norm(dim=2).median(1).values
        spread = spread.masked_fill(~best.isfinite().all(1), torch.nan)
        return torch.stack([-apart.amin(1).double(), (best[:, 0] - other).double(), -spread])


@dataclass
class EvenSample:
    """At most 256 evenly spaced images of a drive whose length is not known before.

    >>> sample = EvenSample()
    >>> for step in range(1000):
    ...     sample.add(torch.tensor([float(step)]))
    >>> len(sample.images), [int(image) for image in sample.images[:4]]
    (250, [0, 4, 8, 12])
    """

    images: list[Float32[Tensor, " d"]] = field(default_factory=list)
    every: int = 1
    seen: int = 0

    def add(self, image: Float32[Tensor, " d"]) -> None:
        """Keep one more image if it is its turn; once there are too many, every second is left."""
        if self.seen % self.every == 0:
            self.images.append(image)
        self.seen += 1
        if len(self.images) > MOST:
            self.images, self.every = self.images[::2], 2 * self.every
