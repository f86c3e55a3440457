r"""The observation likelihood of Xu, Sünderhauf and Milford: a sum over the nearest map images, not a Gaussian process.

.. math:: g(x) = \sum_{j \in N_3(x)} e^{-\lambda_2 d(x, x_j)}\; e^{-\lambda_1 \|z - y_j\|}, \qquad
   d(x, x_j) = \|\Delta t\| + \omega\, |\Delta\theta|

over the nearest map images by that same distance. :math:`\lambda_1 = \log\delta / (q_{.975} - q_{.025})`, with the
quantiles of the distances from the first query's descriptor to the map's: 95 % of the map span a factor δ in
likelihood, which tempers it. This does not define a distribution of descriptors, so :meth:`KernelSum.predict`, which
the filter does not need, gives the neighbours' mean and variance under the weights of their poses.

Source: M. Xu, N. Sünderhauf, M. Milford, "Probabilistic visual place recognition for hierarchical localization", RA-L
2021, and its public code (ProbFiltersVPR), whose constants are the defaults: δ = 5, λ2 = 0.2 / m, ω = 15 m / rad.
"""

import math
from typing import Annotated

import numpy as np
import torch
from annotated_types import Gt
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.geometry.planar import wrap_angle
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.evidence import Evidence, check_runs
from sextant.localization.observation.model import ObservationModel, Prediction, stored
from sextant.ranges import Count, Positive, checked

QUANTILES = (0.025, 0.975)


class KernelSum(ObservationModel):
    """A kernel sum over the nearest images.

    Only the noise variance of the kernel is used, in :meth:`predict`, and only the tempering of the likelihood, which
    multiplies log g.

    Args:
        neighbours: number of images in the sum.
        pose_rate: λ2, per metre.
        heading_weight: ω, the number of metres equivalent to one radian.
        contrast: δ, above 1.
        appearance_rate: λ1; if None, it is computed from the first observed descriptor and kept from then on.

    Raises:
        UserError: a number is outside its range.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places = DescriptorMap.of(poses, torch.eye(20))
        >>> model = KernelSum().fit(places, PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1))  # only its noise is used
        >>> model.observe(torch.eye(20)[7:8], Likelihood()).over_map().argmax()
        tensor(7)
    """

    @checked
    def __init__(
        self,
        neighbours: Count = 3,
        pose_rate: Positive = 0.2,
        heading_weight: Positive = 15.0,
        contrast: Annotated[float, Gt(1)] = 5.0,
        appearance_rate: Positive | None = None,
    ):
        self.neighbours, self.pose_rate, self.heading_weight = neighbours, pose_rate, heading_weight
        self.contrast, self.appearance_rate = contrast, appearance_rate

    def _fit(self) -> None:
        if self.neighbours > len(self.map):
            raise ArgumentError(
                f"neighbours={self.neighbours} must be at most the {len(self.map)} images of the map",
                f"Set neighbours={len(self.map)} or less.",
            )
        self._rate = self.appearance_rate
        self._index()

    def _index(self) -> None:
        self._tree = cKDTree(self._points(self.map.poses), boxsize=[0.0, 0.0, 2 * math.pi * self.heading_weight])
        self._nearest_of_map: tuple[Tensor, Tensor] | None = None

    def _points(self, poses: Tensor) -> ndarray:
        circle = 2 * math.pi
        # the remainder of a tiny negative angle rounds to 2 pi, which the periodic tree rejects
        around = torch.remainder(poses[:, 2:], circle)
        around = torch.where(around >= circle, 0.0, around)
        points: ndarray = torch.cat([poses[:, :2], around * self.heading_weight], dim=1).numpy()
        return points

    def nearest(self, poses: Float64[Tensor, "n 3"]) -> tuple[Int64[Tensor, "n k"], Float64[Tensor, "n k"]]:
        r"""The exact nearest map images by d, nearest first, and their distances d.

        The tree uses the Euclidean distance :math:`e = \sqrt{\|\Delta t\|^2 + \omega^2 \Delta\theta^2}`, with
        :math:`e \le d \le \sqrt2 e`. Once the k-th best d among the nearest by e is at most the largest e among them,
        no other image can be nearer. Until then, twice as many are considered.
        """
        images = poses.new_empty(len(poses), self.neighbours, dtype=torch.int64)
        far = poses.new_empty(len(poses), self.neighbours)
        points, asking = self._points(poses), torch.arange(len(poses), device=poses.device)
        ask = min(len(self.map), 4 * self.neighbours)
        while len(asking):
            euclidean, found = self._tree.query(points[asking.numpy()], k=range(1, ask + 1))
            candidates = torch.from_numpy(np.asarray(found))
            there, here = self.map.poses[candidates], poses[asking][:, None]
            moved = torch.linalg.vector_norm(there[..., :2] - here[..., :2], dim=-1)
            distance = moved + self.heading_weight * wrap_angle(there[..., 2] - here[..., 2]).abs()
            best, order = distance.topk(self.neighbours, dim=1, largest=False)
            done = (best[:, -1] <= torch.from_numpy(euclidean[:, -1])) | (ask == len(self.map))
            images[asking[done]], far[asking[done]] = candidates.gather(1, order)[done], best[done]
            asking, ask = asking[~done], min(2 * ask, len(self.map))
        return images, far

    def nearest_of_map(self) -> tuple[Int64[Tensor, "n k"], Float64[Tensor, "n k"]]:
        """:meth:`nearest` of the map's own poses, computed once."""
        if self._nearest_of_map is None:
            self._nearest_of_map = self.nearest(self.map.poses)
        return self._nearest_of_map

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """The neighbours' mean under the weights of their poses, and their variance about it plus that of the noise."""
        images, distance = self.nearest(poses)
        weights = torch.softmax(-self.pose_rate * distance, dim=1)
        descriptors = self.map.descriptors[images].double()
        mean = torch.einsum("nk,nkd->nd", weights, descriptors)
        squared = (descriptors - mean[:, None]).square().mean(-1)
        return Prediction(mean, (weights * squared).sum(1) + self.kernel.noise_variance)

    def observe(self, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood) -> Evidence:
        """See :class:`ObservationModel`; the first descriptor without nan sets λ1, if it was not given."""
        self.check_dimension(descriptors)
        return KernelSumEvidence(self, self._distances(descriptors), likelihood.tempering)

    def rate(self, distances: Float64[Tensor, "r n"]) -> float:
        """λ1; if not set, it is computed from the first finite row of distances to the map, and nan without one."""
        if self._rate is None:
            first = next((row for row in distances if torch.isfinite(row).all()), None)
            if first is None:
                return math.nan
            low, high = np.quantile(first.numpy(), QUANTILES)
            # if all images of the map are equally far, they do not distinguish places, and any rate will do
            self._rate = math.log(self.contrast) / (high - low) if high > low else 0.0
        return self._rate

    def _distances(self, descriptors: Tensor) -> Tensor:
        rows = [torch.linalg.vector_norm(some - self.map.descriptors, dim=1) for some in descriptors]
        return torch.stack(rows).double()

    def state(self) -> dict[str, Tensor]:
        """λ1; nan while it is not known."""
        rate = math.nan if self._rate is None else self._rate
        return {"appearance_rate": torch.tensor([rate], dtype=torch.float64)}

    def _load(self, state: dict[str, Tensor]) -> None:
        rate = float(stored(state, "appearance_rate", (1,)))
        self._rate = None if math.isnan(rate) else rate
        self._index()


class KernelSumEvidence(Evidence):
    """Log g of one query in each run."""

    def __init__(self, model: KernelSum, distances: Float64[Tensor, "r n"], tempering: float):
        self.model, self.tempering = model, tempering
        self.similarity = -model.rate(distances) * distances

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        check_runs(poses, len(self.similarity))
        runs, particles, _ = poses.shape
        images, distance = self.model.nearest(poses.reshape(-1, 3))
        similar = self.similarity.gather(1, images.view(runs, -1)).view(runs, particles, -1)
        return self._sum(similar, distance.view(runs, particles, -1))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`."""
        images, distance = self.model.nearest_of_map()
        return self._sum(self.similarity[:, images], distance)

    def _sum(self, similarity: Tensor, distance: Tensor) -> Tensor:
        return self.tempering * torch.logsumexp(similarity - self.model.pose_rate * distance, dim=-1)
