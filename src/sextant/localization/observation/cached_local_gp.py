r"""The local Gaussian process with everything independent of the pose precomputed: no solve, no descriptor per pose.

All poses whose nearest image is i use the neighbourhood N of i, with :math:`L L^T = K_{NN} + s_n^2 I` and the centred
descriptors :math:`Y_c`. :math:`L^{-1}` and :math:`M = L^{-1} Y_c Y_c^T L^{-T}` are precomputed. An observation z then
costs one product of a matrix with a vector, :math:`Y z_c`, and each pose ``O(k^2)``:

.. math:: v = L^{-1} k_N, \quad \|z - \mu(x)\|^2 = \|z_c\|^2 - 2 v^T L^{-1} (Y_c z_c)_N + v^T M v, \quad
   s^2(x) = s_f^2 - \|v\|^2 + s_n^2.

Up to rounding it equals :class:`~sextant.localization.observation.local_gp.LocalGP` with
``neighbourhood="nearest_image"``. Besides the map it takes ``n (4 k^2 + 12 k + 24)`` bytes of memory, 213 MB for
172,000 images and k = 16. If the noise is below 1/1000 of the signal, :math:`L^{-1}` is kept in float64, which takes
``n (6 k^2 + 14 k + 24)`` bytes. The search takes about 120 bytes more for each image.

Source: the neighbourhoods of the m nearest images are weighted as experts, as in Y. Cao, D. J. Fleet, "Generalized
product of experts for automatic and principled fusion of Gaussian process predictions", 2014.
"""

from copy import copy
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import _cache_kernels as machine
from sextant.localization.observation._caches import Caches
from sextant.localization.observation._factor import noisy_variance
from sextant.localization.observation._rounded_rows import RoundedRows
from sextant.localization.observation.evidence import Evidence, check_runs
from sextant.localization.observation.model import ObservationModel, Prediction, Residuals
from sextant.localization.observation.neighbourhoods import Neighbourhoods, check_neighbours
from sextant.ranges import Count, checked


def blending_weights(squared: Float64[Tensor, "n k"], m: int) -> Float64[Tensor, "n m"]:
    r"""The weights of the m nearest; each row sums to one.

    .. math:: w_i \propto e^{-d_i^2} - e^{-d_{m+1}^2}, \qquad i = 1, \dots, m

    with the distances :math:`d_1 \le \dots \le d_{m+1}`. A place that leaves the m nearest has weight 0 as it leaves,
    and so has the one that joins them. The weights are discontinuous only where all m + 1 are equally far; there they
    are all equal.

    Args:
        squared: squared distances of the nearest places, ascending: m + 1 of them, or m if there are no more.
        m: number of places with a weight.
    """
    falling = torch.exp(squared[:, :1] - squared)  # relative to the nearest: far from the map all would underflow
    weights = falling[:, :m] - falling[:, m:] if squared.shape[1] > m else falling
    total = weights.sum(dim=1, keepdim=True)
    return torch.where(total > 0, weights / total, torch.full_like(weights, 1 / m))


MapEvidence = Literal["image", "mean"]
_SPATIAL = {"rbf": machine.RBF, "matern32": machine.MATERN32, "matern52": machine.MATERN52}
#: Gathered descriptor values that are held at a time: 16 MiB in float32.
ENTRIES = 2**22


class CachedLocalGP(ObservationModel):
    """The local Gaussian process for large maps and many poses.

    Args:
        neighbours: k, the number of neighbours.
        blend: m. With 2 or more, the log-likelihood is a weighted mean over the neighbourhoods of the m nearest images
            (:func:`~sextant.localization.observation.cached_local_gp.blending_weights`) and continuous over poses. With
            1 it jumps where another image becomes the nearest. (A mixture, a mean of likelihoods, is continuous too,
            but as steep as a jump where a neighbourhood of almost no weight explains the image far better.)
        map_evidence: what the likelihood over the map compares an observation with. ``image``: the map image itself, at
            no cost. ``mean``: the prediction at its pose, as for other poses, at about the cost of another product of
            the map with a vector.
        tile: number of consecutive map images that an observation is compared with together, once poses need one of
            them. Of a mapped map larger than memory, in :func:`~sextant.localization.tiled_map.spatial_order`, only
            these are read. None: all at once, which is fastest in memory. The likelihood over the map needs all.
        rounded: compare observations with descriptors rounded to eight bits, which takes ``n d`` bytes more. One
            observation at a time takes half as long, several together as long as without. Predictions do not change.

    Raises:
        ArgumentError: ``map_evidence`` is unknown, or ``tile`` is below 1.
        ValueError: ``tile`` is given with ``rounded``.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import LocalGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.rand(20, 8)), PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1)
        >>> here, slow = poses[:4] + 0.3, LocalGP(4, "nearest_image").fit(places, kernel)
        >>> CachedLocalGP(4).fit(places, kernel).predict(here).mean.allclose(slow.predict(here).mean, atol=1e-5)
        True
    """

    @checked
    def __init__(
        self,
        neighbours: Count = 16,
        blend: Count = 1,
        map_evidence: MapEvidence = "image",
        tile: Count | None = None,
        rounded: bool = False,
    ):
        if tile is not None and rounded:
            raise ValueError(f"tile={tile} reads part of the map, but rounded=True holds all of it: use only one")
        self.neighbours, self.blend, self.map_evidence, self.tile = neighbours, blend, map_evidence, tile
        self.rounded = rounded

    def _fit(self) -> None:
        self._prepare()
        self.caches = Caches.build(self.map, self.kernel, self.neighbourhoods, self.neighbours)

    def _prepare(self) -> None:
        check_neighbours(self.neighbours, len(self.map))
        if not 1 <= self.blend <= len(self.map):
            raise ArgumentError(
                f"blend={self.blend} must be in [1, {len(self.map)}], the number of images in the map",
                "Set blend=1, or 3 for a likelihood without jumps.",
            )
        self.neighbourhoods = Neighbourhoods(self.map.poses, self.kernel)
        self._rows = RoundedRows.of(self.map.descriptors.numpy()) if self.rounded else None
        self._terms: tuple[Likelihood, Tensor, Tensor] | None = None

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`ObservationModel`; for a blend, the Gaussian proportional to the product of experts."""
        images, shares = self._near(poses)
        mean, variance = self._predict(poses.repeat_interleave(self.blend, dim=0), images.flatten())
        if self.blend == 1:
            return Prediction(mean, variance)
        precision = shares / variance.view(shares.shape)
        together = 1 / precision.sum(dim=1)
        experts = mean.view(*shares.shape, self.map.dimension)
        return Prediction(together[:, None] * torch.einsum("nm,nmd->nd", precision, experts), together)

    def _predict(self, poses: Tensor, images: Tensor) -> tuple[Tensor, Tensor]:
        weights, explained = np.empty((len(images), self.neighbours)), np.empty(len(images))
        machine.interpolation_weights(
            *self._covariance, self.kernel.features(poses).numpy(), images.numpy(),
            self.neighbourhoods.features, self.caches.neighbours, self.caches.whiteners, weights, explained,
        )  # fmt: skip
        rows = torch.from_numpy(self.caches.neighbours)[images].long()
        mean = poses.new_empty(len(images), self.map.dimension)
        at_a_time = max(1, ENTRIES // (self.neighbours * self.map.dimension))
        for start in range(0, len(images), at_a_time):
            some = slice(start, start + at_a_time)
            centred = (self.map.descriptors[rows[some]] - self.map.mean).double()
            mean[some] = torch.einsum("nk,nkd->nd", torch.from_numpy(weights[some]), centred)
        return self.map.mean + mean, noisy_variance(self.kernel, torch.from_numpy(explained))

    @property
    def _covariance(self) -> tuple[int, float]:
        return _SPATIAL[self.kernel.spatial], self.kernel.signal_variance

    def _near(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """The ``blend`` nearest images and their weights."""
        if self.blend == 1:
            return self.neighbourhoods.nearest(poses)[:, None], poses.new_ones(len(poses), 1)
        nearest = self.neighbourhoods.of_poses(poses, min(self.blend + 1, len(self.map)))
        return nearest.rows[:, : self.blend], blending_weights(nearest.squared, self.blend)

    def observe(self, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood) -> "CachedEvidence":
        """See :class:`ObservationModel`."""
        self.check_dimension(descriptors)
        return CachedEvidence(self, descriptors, likelihood)

    def products(self, centred: Float32[ndarray, "r d"]) -> Float32[ndarray, "r n"]:
        """Products of centred observations with the descriptors of the map, which are rounded with ``rounded``."""
        if self._rows is not None:
            return self._rows.products(centred)
        return _products(self.map.descriptors.numpy(), centred)

    def residuals_over_map(self, descriptors: Float32[Tensor, "r d"]) -> Residuals:
        """See :class:`ObservationModel`; see ``map_evidence``."""
        squared = self.observe(descriptors, Likelihood()).squared_over_map()
        return Residuals(squared, torch.from_numpy(self.caches.variances).expand_as(squared))

    def map_terms(self, likelihood: Likelihood) -> tuple[Float64[Tensor, "#r n"], Float64[Tensor, "#r n"]]:
        r"""Level and slope of the log-likelihood over the map, which is affine in the squared distance if Gaussian.

        With :math:`\|z - y_i\|^2 = c + \|y_i - m\|^2 - 2 s_i`, it is ``level + slope (2 s - c)``. The variances of the
        map do not change, so their logarithms are computed once for each likelihood that all runs share.
        """
        shared = not isinstance(likelihood.appearance_variance, Tensor)
        if shared and self._terms is not None and self._terms[0] == likelihood:
            return self._terms[1:]
        variances, norms = torch.from_numpy(self.caches.variances)[None], torch.from_numpy(self._map_norms)[None]
        at = [likelihood.log_prob(torch.full_like(norms, q), variances, self.map.dimension) for q in (0.0, 1.0)]
        slopes = at[0] - at[1]
        levels = at[0] - slopes * norms
        if shared:
            self._terms = likelihood, levels, slopes
        return levels, slopes

    @property
    def _map_norms(self) -> Float64[ndarray, " n"]:
        return self.caches.image_norms if self.map_evidence == "image" else self.caches.mean_norms

    def state(self) -> dict[str, Tensor]:
        """See :class:`ObservationModel`."""
        return self.caches.state()

    def _load(self, state: dict[str, Tensor]) -> None:
        self._prepare()
        self.caches = Caches.of_state(state, len(self.map), self.neighbours, self.kernel)


class CachedEvidence(Evidence):
    """One observation in each of r runs, compared with the map's descriptors by products: with all, or tile by tile.

    Attributes:
        unread: tiles of the map that no pose has needed yet.
    """

    def __init__(self, model: CachedLocalGP, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood):
        self.model, self.likelihood = model, likelihood
        centred = descriptors - model.map.mean
        self._centred, images = centred.numpy(), len(model.map)
        if model.tile is None:
            self.products = model.products(self._centred)
            self._tile, self.unread = images, np.zeros(1, dtype=bool)
        else:
            self.products = np.empty((len(centred), images), np.float32)  # takes memory only where it is written
            self._tile, self.unread = model.tile, np.ones(-(-images // model.tile), dtype=bool)
        self.offsets = centred.double() @ model.map.mean.double()
        self.norms = centred.double().square().sum(dim=1)

    def under(self, model: CachedLocalGP) -> "CachedEvidence":
        """The same observations under another kernel; their products with the images of the map are shared."""
        other = copy(self)
        other.model = model
        return other

    def _read(self, wanted: Bool[ndarray, " tiles"]) -> None:
        """Compare the observations with the images of some tiles."""
        rows = self.model.map.descriptors.numpy()
        for tile in np.flatnonzero(wanted & self.unread).tolist():
            some = slice(tile * self._tile, (tile + 1) * self._tile)
            self.products[:, some] = _products(rows[some], self._centred)
        self.unread &= ~wanted

    def _read_around(self, images: Tensor) -> None:
        """Compare the observations with all neighbours of these images."""
        wanted = np.zeros_like(self.unread)
        wanted[np.unique(self.model.caches.neighbours[np.unique(images.numpy())] // self._tile)] = True
        self._read(wanted)

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        check_runs(poses, len(self.norms))  # machine code would read past the last descriptor
        model, (runs, particles, _) = self.model, poses.shape
        flat = poses.reshape(-1, 3)
        images, shares = model._near(flat)
        if self.unread.any():
            self._read_around(images)
        residuals = self._residuals(flat, images, particles)
        squared, variance = residuals.squared.view(runs, -1), residuals.variance.view(runs, -1)
        told = self.likelihood.log_prob(squared, variance, model.map.dimension).view(shares.shape)
        return (shares * told).sum(dim=1).view(runs, particles)

    def _residuals(self, poses: Tensor, images: Tensor, particles: int) -> Residuals:
        model, blend = self.model, images.shape[1]
        features = model.kernel.features(poses).repeat_interleave(blend, dim=0).numpy()
        runs = np.repeat(np.arange(len(self.norms)), particles * blend)
        squared, explained = np.empty(len(runs)), np.empty(len(runs))
        caches = model.caches
        machine.gram_residuals(
            *model._covariance, features, runs, images.flatten().numpy(),
            model.neighbourhoods.features, caches.neighbours, caches.whiteners, caches.grams,
            self.products, self.offsets.numpy(), self.norms.numpy(), squared, explained,
        )  # fmt: skip
        variance = noisy_variance(model.kernel, torch.from_numpy(explained))
        return Residuals(torch.from_numpy(squared).view(-1, blend), variance.view(-1, blend))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`; see ``map_evidence`` of the model."""
        model = self.model
        if self.likelihood.form == "student":
            variances = torch.from_numpy(model.caches.variances)
            return self.likelihood.log_prob(self.squared_over_map(), variances, model.map.dimension)
        self._read(np.ones_like(self.unread))
        levels, slopes = model.map_terms(self.likelihood)
        return self._over_map(levels.numpy(), slopes.numpy())

    def squared_over_map(self) -> Float64[Tensor, "r n"]:
        """Squared distances from the observation to the images of the map, or to the predictions at their poses."""
        self._read(np.ones_like(self.unread))
        return self._over_map(self.model._map_norms[None], np.full((1, len(self.model.map)), -1.0)).clamp_min_(0)

    def _over_map(self, levels: Float64[ndarray, "#r n"], slopes: Float64[ndarray, "#r n"]) -> Float64[Tensor, "r n"]:
        r""":math:`\mathrm{level} + \mathrm{slope}\,(2 z_c^T m - \|z_c\|^2)`, m the image or the prediction there."""
        caches, norms, offsets = self.model.caches, self.norms.numpy(), self.offsets.numpy()
        scores = np.empty(self.products.shape)
        if self.model.map_evidence == "image":
            machine.image_scores(self.products, norms + 2 * offsets, levels, slopes, scores)
        else:
            machine.mean_scores(
                caches.weights, caches.neighbours, self.products, offsets, norms, levels, slopes, scores
            )
        return torch.from_numpy(scores)


def _products(rows: Float32[ndarray, "n d"], centred: Float32[ndarray, "r d"]) -> Float32[ndarray, "r n"]:
    # NumPy's products with tall matrices are several times faster than torch's where it is built without OpenBLAS
    with np.errstate(invalid="ignore", over="ignore"):  # a descriptor with nan gives only nan
        if len(centred) == 1:
            return np.asarray(rows @ centred[0], np.float32)[None]
        return np.asarray(centred @ rows.T, np.float32)
