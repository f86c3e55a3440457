r"""Gaussian-process regression on only the k nearest images of the map.

For a pose x with neighbours N, k of them:

.. math:: w = (K_{NN} + s_n^2 I)^{-1} k_N, \quad \mu(x) = m + \sum_{j \in N} w_j (y_j - m), \quad
   s^2(x) = s_f^2 - k_N^T w + s_n^2.

This is the exact posterior given these images, so it is calibrated, and its variance is never below the exact one. The
set N changes as x moves, and mean and variance jump a little with it.

Sources: A. V. Vecchia, "Estimation and model identification for continuous spatial processes", J. R. Stat. Soc. B 50,
1988; for localization in a city, M. Lopez-Antequera, N. Petkov, J. Gonzalez-Jimenez, "City-scale continuous visual
localization", ECMR 2017, as implemented in the public code AppearanceSeqMCL.
"""

from typing import Literal

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.localization.observation._factor import noisy_factor, noisy_variance
from sextant.localization.observation.model import ObservationModel, Prediction
from sextant.localization.observation.neighbourhoods import Neighbourhoods, check_neighbours
from sextant.ranges import Count, checked

Neighbourhood = Literal["own", "nearest_image"]
#: Gathered descriptor and covariance values that are held at a time: 16 MiB in float32.
ENTRIES = 2**22


class LocalGP(ObservationModel):
    """The posterior given the images near each pose, solved anew for each in ``O(k^3 + k d)``.

    Args:
        neighbours: k, the number of neighbours.
        neighbourhood: ``own``: the images nearest to the pose. ``nearest_image``: those nearest to the image that is
            nearest to the pose. These are the same for all poses around it and can be precomputed, as in
            :class:`~sextant.localization.observation.cached_local_gp.CachedLocalGP`.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[0.0, 0, 0], [4, 0, 0], [50, 0, 0]], dtype=torch.float64)
        >>> places = DescriptorMap.of(poses, torch.tensor([[1.0], [3.0], [5.0]]))
        >>> model = LocalGP(neighbours=2).fit(places, PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.01))
        >>> model.predict(poses).mean.flatten()  # each from its two nearest images
        tensor([1.0198, 3.0000, 4.9802], dtype=torch.float64)
    """

    @checked
    def __init__(self, neighbours: Count = 16, neighbourhood: Neighbourhood = "own"):
        self.neighbours, self.neighbourhood = neighbours, neighbourhood

    def _fit(self) -> None:
        check_neighbours(self.neighbours, len(self.map))
        self.neighbourhoods = Neighbourhoods(self.map.poses, self.kernel)

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`ObservationModel`."""
        at_a_time = max(1, ENTRIES // (self.neighbours * (self.map.dimension + self.neighbours)))
        parts = [self._predict(some) for some in poses.split(at_a_time)]
        return Prediction(torch.cat([mean for mean, _ in parts]), torch.cat([variance for _, variance in parts]))

    def _predict(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        rows = self._rows(poses)
        near = self.map.poses[rows]  # (n, k, 3)
        covariance = self.kernel(near, poses[:, None, :])  # (n, k, 1)
        factor = noisy_factor(self.kernel(near, near), self.kernel.noise_variance)
        known = torch.linalg.solve_triangular(factor, covariance, upper=False)
        weights = torch.linalg.solve_triangular(factor.mT, known, upper=True)
        centred = self.map.descriptors[rows] - self.map.mean  # (n, k, d)
        mean = self.map.mean + torch.einsum("nk,nkd->nd", weights[..., 0], centred.double())
        return mean, noisy_variance(self.kernel, known.square().sum(dim=(1, 2)))

    def _rows(self, poses: Tensor) -> Tensor:
        if self.neighbourhood == "own":
            return self.neighbourhoods.of_poses(poses, self.neighbours).rows
        return self.neighbourhoods.of_images(self.neighbourhoods.nearest(poses), self.neighbours).rows

    def state(self) -> dict[str, Tensor]:
        """Nothing: everything is in the map, and the tree over its poses is quickly rebuilt."""
        return {}

    def _load(self, state: dict[str, Tensor]) -> None:
        self._fit()
