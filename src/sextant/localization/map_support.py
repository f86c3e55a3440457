r"""The support of a map: the poses at which it predicts images. Elsewhere it is uninformative.

Off the map, a Gaussian process falls back to its mean and prior variance. They explain an image of another season, far
from every prediction, better than the true pose does, so the process is used only near the map. Let s(x) in [0, 1] be
the map's share in a pose at distance d from the nearest image,

.. math:: s(x) = e^{-2 \max(0,\, d - 1)^2}, \qquad
   d^2 = \min_i \frac{\|p - p_i\|^2}{r^2} + \frac{2(1 - \cos(\theta - \theta_i))}{\rho^2}.

The log-likelihood of an image is then

.. math:: \tilde l(z \mid x) = \log\!\big[a(x)\, e^{l(z|x)} + (1 - a(x))\, e^{b(z)}\big], \qquad a = (1 - o)\, s(x),
   \quad b(z) = \log \tfrac1N \sum_{i=1}^N e^{l(z \mid x_i)}:

off the map, an image is as likely as on average over the map. The same holds for the share o of images that show
something other than the place, such as a passing car. A robot is off the map with probability :math:`\epsilon`: the
belief contains the factor :math:`g(x) = \epsilon + (1 - \epsilon)\, s(x)` once, however long the robot drives, since a
step multiplies weights by :math:`g(x_t) / g(x_{t-1})`.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.belief import Belief
from sextant.localization.constants import HEADING_REACH, LENGTHS, PLACE, RARE, UNKNOWN
from sextant.localization.descriptor_map import check_finite
from sextant.localization.map_prior import LEAST_SPACING
from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.pose_kernel import PoseKernel
from sextant.ranges import Positive, Share, checked
from sextant.shapes import check_shape

#: number of evenly chosen images from which the spacing of a map is estimated, and neighbours of each
LOOKED_AT, NEIGHBOURS = 4096, 24


@checked
@dataclass(frozen=True)
class MapSupport:
    """The poses at which a map is informative.

    Attributes:
        poses: poses of the map's images.
        reach: r, the distance up to which an image represents poses beside it, in the unit of positions; infinite for
            everywhere.
        heading_reach: ρ, the same for the heading, in rad.
        leave: ε in (0, 1), the probability of being off the map.
        outliers: o in (0, 1), the share of images that are uninformative about their pose.

    Raises:
        UserError: a number is outside its range, or a pose is not three finite numbers.

    >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
    >>> support = MapSupport.of(line)
    >>> support.reach  # half of the map's spacing
    0.5
    >>> support.share(torch.tensor([[4.2, 0.0, 0.0], [4.0, 3.0, 0.0]], dtype=torch.float64)).round().tolist()
    [1.0, 0.0]
    """

    poses: Float64[Tensor, "n 3"]
    reach: float
    heading_reach: Positive = HEADING_REACH
    leave: Share = RARE
    outliers: Share = RARE

    def __post_init__(self) -> None:
        if not self.reach > 0:  # it may be infinite
            raise ArgumentError(f"reach={self.reach} must be above 0", "For example reach=1")
        check_shape("poses", self.poses, "n", 3)
        check_finite(self.poses)

    @classmethod
    def of(cls, poses: Float64[Tensor, "n 3"], kernel: PoseKernel | None = None) -> "MapSupport":
        """The support that reaches half of the map's own spacing, and half of the turn between images at one place.

        Args:
            poses: poses of the map's images.
            kernel: kernel learnt on them. In a dense map, where its shorter length is 2.5 spacings or more, images
                reach 1.5 times that length. This does not hold for a map along one line, which does not show how far
                images reach sideways, nor for a kernel with more noise than signal: images at one place then have less
                in common than not.
        """
        spacing, length = map_spacing(poses), 0.0
        if kernel is not None and kernel.signal_variance > kernel.noise_variance:
            length = min(kernel.length)
        learnt = PLACE * spacing <= length <= _breadth(poses)
        return cls(poses, LENGTHS * length if learnt else spacing / 2, heading_reach(poses))

    @classmethod
    def everywhere(cls, poses: Float64[Tensor, "n 3"], outliers: float) -> "MapSupport":
        """Support at every pose, with a share of images that are uninformative about their pose.

        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
        >>> MapSupport.everywhere(line, outliers=0.1).share(line + 1000).min()
        tensor(1., dtype=torch.float64)
        """
        return cls(poses, math.inf, heading_reach(poses), outliers=outliers)

    @cached_property
    def _near(self) -> Neighbourhoods:
        return Neighbourhoods(self.poses, PoseKernel("rbf", (self.reach, self.reach), self.heading_reach, 1.0, 0.0))

    def share(self, poses: Float64[Tensor, "*b 3"]) -> Float64[Tensor, "*b"]:
        """The share s(x) of the map in each pose."""
        if self.reach == math.inf:
            return poses.new_ones(poses.shape[:-1])
        flat = poses.reshape(-1, 3)
        apart = self._near.kernel.features(flat) - torch.from_numpy(self._near.features)[self._near.nearest(flat)]
        beyond = (apart.norm(dim=1) - 1).clamp(min=0)
        return torch.exp(-2 * beyond * beyond).view(poses.shape[:-1])

    def log_change(self, before: Float64[Tensor, "r p 3"], after: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        r""":math:`\log g(x_t) / g(x_{t-1})` of particles that moved from one pose to another."""
        return self.log_prior(after) - self.log_prior(before)

    def off_map(self, belief: Belief) -> Float64[Tensor, "r"]:
        """The probability that each run is off the map."""
        return (belief.weights * (1 - self.share(belief.poses))).sum(1)

    def log_prior(self, poses: Float64[Tensor, "*b 3"]) -> Float64[Tensor, "*b"]:
        r""":math:`\log g(x)`, the prior of poses on the map and off it."""
        return torch.log(self.leave + (1 - self.leave) * self.share(poses))


class EvidenceOnMap(Evidence):
    """Evidence used on the map only; off the map, an observation is as likely as on average over the map.

    Example:
        >>> class Ahead(Evidence):  # the further ahead, the likelier: 1, 3 and 5 at the images
        ...     log_likelihood = lambda self, poses: (1 + poses[..., 0]).log()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]], dtype=torch.float64)
        >>> there = torch.tensor([[[4.0, 0, 0], [98, 0, 0]]], dtype=torch.float64)
        >>> EvidenceOnMap(Ahead(), MapSupport.of(line)).log_likelihood(there).exp()  # off the map the mean of the three
        tensor([[4.9800, 3.0000]], dtype=torch.float64)
    """

    def __init__(self, evidence: Evidence, support: MapSupport):
        self.evidence, self.support = evidence, support

    @cached_property
    def _map(self) -> Float64[Tensor, "r n"]:
        return self.evidence.over_map()

    @cached_property
    def _anywhere(self) -> Float64[Tensor, "r 1"]:
        on_map = torch.where(self._map.isfinite(), self._map, -torch.inf)
        return on_map.logsumexp(1, keepdim=True) - math.log(on_map.shape[1])

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`."""
        return self._map

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        share = (1 - self.support.outliers) * self.support.share(poses)
        return torch.logaddexp(self.evidence.log_likelihood(poses) + share.log(), self._anywhere + torch.log1p(-share))


def images_near(poses: Float64[Tensor, "n 3"]) -> Neighbourhoods:
    """Search for the map images nearest to a pose; half a spacing counts as much as half the turn between images there.

    >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(10)], dtype=torch.float64)
    >>> int(images_near(line).nearest(torch.tensor([[4.2, 0.3, 0.1]], dtype=torch.float64))[0])
    4
    """
    reach = map_spacing(poses) / 2
    return Neighbourhoods(poses, PoseKernel("rbf", (reach, reach), heading_reach(poses), 1.0, 0.0))


#: distance of neighbours at most, in distances of the nearest: an unknown motion to either side. Spacings of 18 maps
#: are the same to 0.1 % with 3.2 to 10 (results/localization_change.md)
FAR = 2 * UNKNOWN


def map_spacing(poses: Float64[Tensor, "n 3"]) -> float:
    """The spacing of a map: how far apart neighbouring positions are, as the median over images of the widest gap.

    The widest gap of an image is the distance to the farthest of its nearest neighbours in four directions, as far as
    it has any. Along a line this is the distance from one image to the next; in an area, the distance between rows.
    Images at one position count once; a map of one position has spacing 1.

    Example:
        >>> rows = [[float(x), 3.0 * row, 0.0] for x in range(9) for row in range(5)]
        >>> round(map_spacing(torch.tensor(rows, dtype=torch.float64)), 4)  # images 1 m apart in rows 3 m apart
        3.0
    """
    positions = np.unique(poses[:, :2].numpy(), axis=0)
    if len(positions) == 1:
        return 1.0
    looked_at = positions[np.unique(np.linspace(0, len(positions) - 1, min(LOOKED_AT, len(positions))).astype(int))]
    distances, rows = cKDTree(positions).query(looked_at, k=np.arange(2, min(NEIGHBOURS, len(positions)) + 1))
    away = positions[rows] - looked_at[:, None]
    along = away[:, :1]  # the first direction is that of the nearest
    cosine, sine = (away * along).sum(2), along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]
    direction = np.round(np.arctan2(sine, cosine) / (np.pi / 2)).astype(int) % 4
    near = distances <= FAR * distances[:, :1]
    nearest = np.stack([np.where(near & (direction == d), distances, np.inf).min(1) for d in range(4)])
    gaps: ndarray = np.where(np.isfinite(nearest), nearest, 0.0).max(0)
    return max(float(np.median(gaps)), LEAST_SPACING)


def heading_reach(poses: Float64[Tensor, "n 3"]) -> float:
    """Half the turn from one image to the next at one position, in rad; 10 degrees if it is less or there is one image.

    Example:
        >>> four = torch.tensor([[0.0, 0.0, math.radians(turn)] for turn in (0, 90, 180, 270)], dtype=torch.float64)
        >>> round(math.degrees(heading_reach(four))), round(math.degrees(heading_reach(four[:1])))
        (45, 10)
    """
    values = poses.numpy()
    values = values[np.lexsort((values[:, 1], values[:, 0]))]
    elsewhere = np.abs(np.diff(values[:, :2], axis=0)).max(1) >= LEAST_SPACING
    position = np.concatenate([[0], np.cumsum(elsewhere)])
    headings = values[:, 2] % math.tau
    headings = headings[np.lexsort((headings, position))]
    last = np.append(np.flatnonzero(elsewhere), len(position) - 1)
    first = np.concatenate([[0], last[:-1] + 1])
    turns = np.diff(headings, append=0.0)
    turns[last] = headings[first] + math.tau - headings[last]
    turns = np.delete(turns, np.lexsort((turns, position))[last])  # the widest spans directions without images
    turns = turns[turns > HEADING_REACH]
    return max(HEADING_REACH, float(np.median(turns)) / 2) if len(turns) else HEADING_REACH


def _breadth(poses: Float64[Tensor, "n 3"]) -> float:
    """The standard deviation of positions across the line that fits them best; 0 for fewer than two."""
    positions = poses[:, :2] - poses[:, :2].mean(0)
    return float(torch.linalg.svdvals(positions)[-1]) / math.sqrt(len(poses)) if len(poses) > 1 else 0.0
