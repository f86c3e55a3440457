"""The kernel's hyper-parameters, positive and differentiable, and the likelihoods to fit them."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from gpytorch.constraints import GreaterThan, Interval
from gpytorch.kernels import Kernel, MaternKernel, PeriodicKernel, RBFKernel, ScaleKernel
from jaxtyping import Float, Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Generator, Tensor, nn

from sextant.errors import ArgumentError, UserError
from sextant.localization.pose_kernel import PoseKernel, Spatial
from sextant.shapes import check_shape

__all__ = [
    "Conditioning",
    "TrainableKernel",
    "joint_log_likelihood",
    "random_order",
    "vecchia_log_likelihood",
]

#: Positions closer than this share of the map's extent are one position.
SAME = 1e-9
#: Descriptors that are processed together.
BLOCK = 16_384


def nearest_distance(positions: Float64[ndarray, "n 2"]) -> float:
    """The median distance from a position to the nearest other one; 1 if there is no other.

    Images at one position count once. Otherwise a map of panoramas cut into views would have distance zero.

    Example:
        >>> round(nearest_distance(np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 4.0]])), 6)
        5.0
    """
    extent = float(np.ptp(positions, axis=0).max())
    if extent == 0:
        return 1.0
    grain = SAME * extent
    cells = np.round((positions - positions.min(0)) / grain).astype(np.int64)
    # one number for both coordinates: each is at most 1e9, so the pair fits in 63 bits
    places = np.unique(cells[:, 0] * (round(1 / SAME) + 1) + cells[:, 1])
    points = grain * np.column_stack(np.divmod(places, round(1 / SAME) + 1)).astype(np.float64)
    distances, _ = cKDTree(points).query(points, k=2)
    return float(np.median(distances[:, 1]))


def mean_variance(descriptors: Float[Tensor, "n d"]) -> float:
    """The variance of descriptor values about their means, averaged over dimensions and computed in blocks.

    Example:
        >>> mean_variance(torch.tensor([[0.0, 1.0], [2.0, 1.0]]))  # 1 and 0
        0.5
    """
    blocks = descriptors.split(BLOCK)
    mean = sum(rows.double().sum(0) for rows in blocks) / len(descriptors)
    squares = [float((rows.double() - mean).square().sum()) for rows in blocks]
    return sum(squares) / descriptors.numel()


def random_order(images: int, generator: Generator) -> Int64[ndarray, " n"]:
    """A random permutation of the images, in O(n).

    Source: J. Guinness, "Permutation and grouping methods for sharpening Gaussian process approximations",
    Technometrics 2018: a maximum-minimum-distance order is the most accurate, a random one nearly so, and sorting by a
    coordinate worse.

    Example:
        >>> order = random_order(5, torch.Generator().manual_seed(0))
        >>> sorted(order.tolist())  # each image once
        [0, 1, 2, 3, 4]
    """
    return torch.randperm(images, generator=generator).numpy()


#: Starting values: lengths in nearest distances between map images, the noise as a share of the descriptors' variance.
STEPS_OF_LENGTH = 4.0
NOISE_SHARE = 0.2
#: In rad: views turned by 40 degrees share about half of their field of view.
HEADING_LENGTH = 0.7
#: The noise never falls below this share of its starting value, so that the factorisation stays possible.
LEAST_NOISE = 1e-4
#: share of the descriptors' mean square below which their variance is due to rounding
ROUNDING = 1e-10
SMOOTHNESS = {"matern32": 1.5, "matern52": 2.5}


class TrainableKernel(nn.Module):
    r"""A :class:`~sextant.localization.pose_kernel.PoseKernel` to be trained by gradients.

    .. math:: k(a, b) = \sigma_f^2\, g\!\left(\sqrt{\tfrac{\Delta x^2}{\ell_x^2} + \tfrac{\Delta y^2}{\ell_y^2}}\right)
       e^{-(1 - \cos\Delta\theta) / \ell_\theta^2}

    with g the RBF or a Matérn. GPyTorch's ``PeriodicKernel`` of period 2π is
    :math:`e^{-2\sin^2(\Delta\theta/2)/\lambda} = e^{-(1-\cos\Delta\theta)/\lambda}`: its :math:`\lambda`, which it
    calls a length, is :math:`\ell_\theta^2`. The logarithms of parameters are trained, so that a step is relative and
    does not depend on the unit of positions or descriptors. Everything is float64, as covariance matrices of closely
    spaced images are nearly singular.

    A dimension in which the map does not vary, such as y on a railway, has zero gradient: its length keeps its start.

    Args:
        start: the kernel from which training starts.
        ard: train a length each for x and y; otherwise they share one, which starts at their geometric mean.

    Example:
        >>> line = torch.tensor([[2.0 * x, 0.0, 0.0] for x in range(5)], dtype=torch.float64)
        >>> kernel = TrainableKernel.from_map(line, torch.arange(5.0)[:, None])  # 2 m apart, of variance 2
        >>> start = kernel.frozen()
        >>> [round(value, 4) for value in (*start.length, start.signal_variance, start.noise_variance)]
        [8.0, 8.0, 1.6, 0.4]
        >>> kernel(line, line).allclose(start(line, line))  # the same covariance, with gradients
        True
    """

    def __init__(self, start: PoseKernel, *, ard: bool = True):
        super().__init__()
        self.spatial = start.spatial
        self.ard = ard
        translation = _translation_kernel(start.spatial, 2 if ard else None)
        rotation = PeriodicKernel(
            active_dims=(2,), lengthscale_constraint=_exponential(), period_length_constraint=_exponential()
        )
        self.covariance = ScaleKernel(translation * rotation, outputscale_constraint=_exponential())
        self.noise_constraint = _exponential(LEAST_NOISE * start.noise_variance)
        self.raw_noise = nn.Parameter(torch.zeros(()))
        self.double()

        x, y = start.length
        # as tensors: GPyTorch rounds numbers to the default type, and 2π in single precision is not a full turn
        translation.lengthscale = _exactly([x, y] if ard else [math.sqrt(x * y)])
        rotation.period_length = _exactly(2 * math.pi)
        rotation.raw_period_length.requires_grad_(False)
        rotation.lengthscale = _exactly(start.heading_length**2)
        self.covariance.outputscale = _exactly(start.signal_variance)
        self.raw_noise.data = self.noise_constraint.inverse_transform(_exactly(start.noise_variance))
        self._translation, self._rotation = translation, rotation

    @classmethod
    def from_map(
        cls,
        poses: Float64[Tensor, "n 3"],
        descriptors: Float32[Tensor, "n d"] | Float64[Tensor, "n d"],
        *,
        spatial: Spatial = "rbf",
        ard: bool = True,
    ) -> Self:
        """Make a kernel with starting values taken from the map.

        The length is four times the median distance from a position to the nearest other one (1 if there is none). The
        descriptors' variance, averaged over dimensions, is split into signal and noise.

        Args:
            poses: poses of the map's images.
            descriptors: descriptors of the same images.
            spatial: form of the kernel on positions.
            ard: as for the class.

        Raises:
            UserError: poses or descriptors are not rows, or the descriptors are all equal.
            ValueError: there are no poses, or not one descriptor for each.
        """
        check_shape("poses", poses, "n", 3)
        check_shape("descriptors", descriptors, "n", "d")
        if not len(poses) or len(poses) != len(descriptors):
            raise ValueError(f"need a descriptor for each pose; got {len(descriptors)} for {len(poses)}")
        variance = mean_variance(descriptors)
        if not variance > ROUNDING * float(descriptors.double().square().mean()):
            raise UserError(
                f"the map's {len(poses)} descriptors are all equal, so its places cannot be distinguished",
                "Choose another descriptor, or check the images of the map.",
            )
        rows = poses.detach().cpu().numpy().astype(np.float64)
        length = STEPS_OF_LENGTH * nearest_distance(rows[:, :2])
        start = PoseKernel(
            spatial=spatial,
            length=(length, length),
            heading_length=HEADING_LENGTH,
            signal_variance=(1 - NOISE_SHARE) * variance,
            noise_variance=NOISE_SHARE * variance,
        )
        return cls(start, ard=ard)

    def forward(self, a: Float[Tensor, "*batch n 3"], b: Float[Tensor, "*batch m 3"]) -> Float64[Tensor, "*batch n m"]:
        """The covariance of the signal between two sets of poses, without noise."""
        dense: Tensor = self.covariance(a.double(), b.double()).to_dense()
        return dense

    @property
    def noise_variance(self) -> Float64[Tensor, ""]:
        """The noise variance of an observation, in every dimension of the descriptor."""
        transformed: Tensor = self.noise_constraint.transform(self.raw_noise)
        return transformed

    @property
    def signal_variance(self) -> Float64[Tensor, ""]:
        """The prior variance of the signal, in every dimension of the descriptor."""
        scale: Tensor = self.covariance.outputscale
        return scale

    def frozen(self) -> PoseKernel:
        """The kernel with its current parameters."""
        lengths = self._translation.lengthscale.detach().flatten().tolist()
        return PoseKernel(
            spatial=self.spatial,
            length=(lengths[0], lengths[-1]),
            heading_length=math.sqrt(self._rotation.lengthscale.item()),
            signal_variance=self.signal_variance.item(),
            noise_variance=self.noise_variance.item(),
        )


def _translation_kernel(spatial: Spatial, ard: int | None) -> Kernel:
    if spatial == "rbf":
        return RBFKernel(ard_num_dims=ard, active_dims=(0, 1), lengthscale_constraint=_exponential())
    smoothness = SMOOTHNESS[spatial]
    return MaternKernel(smoothness, ard_num_dims=ard, active_dims=(0, 1), lengthscale_constraint=_exponential())


def _exactly(value: float | list[float]) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def _exponential(above: float = 0.0) -> Interval:
    return GreaterThan(above, transform=torch.exp, inv_transform=torch.log)


def joint_log_likelihood(
    kernel: TrainableKernel,
    poses: Float[Tensor, "n 3"],
    descriptors: Float[Tensor, "n d"],
    mean: Float[Tensor, " d"],
) -> Float64[Tensor, ""]:
    r"""The log-likelihood of all descriptors in nats, differentiable in the kernel's parameters.

    .. math:: \log p(Y) = -\tfrac12 \operatorname{tr}\!\big(\bar Y^\top K_y^{-1} \bar Y\big)
       - \tfrac{D}{2} \log|K_y| - \tfrac{ND}{2} \log 2\pi, \qquad K_y = K + \sigma_n^2 I,\ \bar Y = Y - \mathbf 1 m^\top

    One Cholesky factorisation serves all outputs; D models of one output each would need D factorisations.

    Source: C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, equation 2.30.

    Takes O(n³ + n²d) time and O(n²) memory, which suits a few thousand images. For more see
    :func:`~sextant.localization.hyperparameters.vecchia_log_likelihood`.

    Args:
        kernel: the kernel with its noise.
        poses: poses of the images.
        descriptors: descriptors of the same images, one in each row.
        mean: mean descriptor.

    Raises:
        UserError: the covariance matrix is singular to working precision, as the noise is too small for images so
            close.

    Example:
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> kernel = TrainableKernel(PoseKernel("rbf", (1.0, 1.0), 1.0, signal_variance=0.5, noise_variance=0.5))
        >>> poses = torch.tensor([[0.0, 0, 0], [100, 0, 0]], dtype=torch.float64)  # too far apart to be correlated
        >>> found = joint_log_likelihood(kernel, poses, torch.ones(2, 3), torch.ones(3))
        >>> round(found.item() / math.log(2 * math.pi), 4)  # -1/2 for each of six numbers at their mean
        -3.0
    """
    residuals = (descriptors - mean).double()
    n, outputs = residuals.shape
    covariance = kernel(poses, poses) + kernel.noise_variance * torch.eye(n, dtype=torch.float64)
    factor, failed = torch.linalg.cholesky_ex(covariance)
    if failed:
        raise UserError(
            f"the covariance of {n} map images is singular: the noise variance {kernel.noise_variance.item():.3g} is "
            "too small for images so close",
            "Raise kernel.noise_variance, or thin the map.",
        )
    whitened = torch.linalg.solve_triangular(factor, residuals, upper=False)
    log_determinant = 2 * factor.diagonal().log().sum()
    value: Tensor = -0.5 * (whitened.square().sum() + outputs * log_determinant + n * outputs * math.log(2 * math.pi))
    return value


@dataclass(frozen=True)
class Conditioning:
    r"""The images on which each image of a map is conditioned.

    .. math:: \log p(Y) = \sum_i \log p(y_i \mid y_{1:i-1}) \approx \sum_i \log p(y_i \mid y_{N(i)}), \qquad
       N(i) = k \text{ nearest of } 1..i-1

    Each term is a small regression, so a whole map costs O(n k³). A uniformly drawn minibatch B of rows, scaled by n /
    |B|, is an unbiased estimate of the sum and of its gradient: 172,000 images train in constant memory. With k = n - 1
    it is the exact likelihood. It serves only to fit hyper-parameters; the local Gaussian process predicts on the same
    principle.

    Neighbours among earlier images are found with one k-d tree for each prefix of 2^j images of the order. Row i of
    [2^(j-1), 2^j) queries the tree of the first 2^j for its nearest images and keeps those before i, which are half of
    them or more on average. Rows with too few are queried again for twice as many. The result is exact.

    Sources: A. V. Vecchia, "Estimation and model identification for continuous spatial processes", JRSS B 1988; M.
    Katzfuss and J. Guinness, "A general framework for Vecchia approximations of Gaussian processes", Statistical
    Science 2021.

    Attributes:
        order: the images in the order of conditioning.
        neighbours: for image i of the map (not of the order), the images it is conditioned on, nearest first; -1 where
            fewer than k precede it.

    Example:
        >>> places = np.array([[0.0], [1.0], [3.0], [1.2]])
        >>> Conditioning.of(places, np.array([0, 2, 1, 3]), neighbours=1).neighbours.flatten()  # 1.2 on 1
        tensor([-1,  0,  0,  1])
    """

    order: Int64[Tensor, " n"]
    neighbours: Int64[Tensor, "n k"]

    @classmethod
    def of(cls, features: Float64[ndarray, "n f"], order: Int64[ndarray, " n"], neighbours: int) -> Self:
        """Condition each image on the nearest ``neighbours`` images that precede it.

        Args:
            features: points whose Euclidean distance defines what is near, such as those of ``PoseKernel.features``.
            order: a permutation of the images.
            neighbours: k, at least 1; more than n - 1 count as n - 1.

        Raises:
            UserError: fewer than one neighbour.
            ValueError: ``order`` is not a permutation of the images.
        """
        if neighbours < 1:
            raise ArgumentError(f"neighbours={neighbours} must be at least 1", "Set neighbours=30.")
        if not np.array_equal(np.sort(order), np.arange(len(features))):
            raise ValueError(f"order must hold each of the {len(features)} images once")
        places = preceding_neighbours(features[order], min(neighbours, max(1, len(order) - 1)))
        table = np.empty_like(places)
        table[order] = np.where(places >= 0, order[places], -1)
        return cls(torch.from_numpy(np.ascontiguousarray(order)), torch.from_numpy(table))


def preceding_neighbours(features: Float64[ndarray, "n f"], neighbours: int) -> Int64[ndarray, "n k"]:
    """The nearest ``neighbours`` rows that precede each row, nearest first; -1 where there are fewer.

    Example:
        >>> preceding_neighbours(np.array([[0.0], [5.0], [1.0]]), 2).tolist()
        [[-1, -1], [0, -1], [0, 1]]
    """
    table = np.full((len(features), neighbours), -1, dtype=np.int64)
    start, stop = 1, 2
    while start < len(features):
        stop = min(stop, len(features))
        tree = cKDTree(features[:stop])
        asking, ask = np.arange(start, stop), min(stop, 2 * neighbours + 2)
        while len(asking):
            _, found = tree.query(features[asking], k=range(1, ask + 1))
            earlier = found < asking[:, None]
            done = (earlier.sum(1) >= np.minimum(neighbours, asking)) | (ask == stop)
            # a stable sort brings the earlier ones to the front, still nearest first
            front = np.argsort(~earlier[done], axis=1, kind="stable")[:, :neighbours]
            rows = np.take_along_axis(np.where(earlier[done], found[done], -1), front, axis=1)
            table[asking[done], : rows.shape[1]] = rows
            asking, ask = asking[~done], min(2 * ask, stop)
        start, stop = stop, 2 * stop
    return table


def vecchia_log_likelihood(
    kernel: TrainableKernel,
    poses: Float[Tensor, "n 3"],
    descriptors: Float[Tensor, "n d"],
    mean: Float[Tensor, " d"],
    conditioning: Conditioning,
    rows: Int64[Tensor, " b"] | None = None,
) -> Float64[Tensor, ""]:
    """Vecchia's log-likelihood in nats: exact if all rows are given, otherwise an unbiased estimate from some.

    Takes O(b (k³ + k d)) time and O(b k (k + d)) memory: call it with minibatches.

    Args:
        kernel: the kernel with its noise; the neighbours are not chosen again when it changes.
        poses: poses of the images.
        descriptors: descriptors of the same images; may be a tensor over a memory map.
        mean: mean descriptor.
        conditioning: conditioning of the same images.
        rows: rows drawn uniformly; all by default.

    Raises:
        UserError: neighbouring images have a covariance that is singular to working precision.

    Example:
        >>> from sextant.localization.hyperparameters import joint_log_likelihood
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(6)], dtype=torch.float64)
        >>> images = line, torch.eye(6), torch.zeros(6)
        >>> kernel = TrainableKernel.from_map(line, torch.eye(6))
        >>> given_all = Conditioning.of(line.numpy(), np.arange(6), neighbours=5)  # on all earlier images
        >>> vecchia_log_likelihood(kernel, *images, given_all).allclose(joint_log_likelihood(kernel, *images))
        True
    """
    rows = torch.arange(len(poses)) if rows is None else rows
    near = conditioning.neighbours[rows]
    absent = near < 0
    near = near.clamp(min=0)
    noise = kernel.noise_variance
    one = poses[rows][:, None]
    cross = kernel(poses[near], one).squeeze(-1).masked_fill(absent, 0.0)  # (b, k)
    among = kernel(poses[near], poses[near]) + noise * torch.eye(near.shape[1], dtype=torch.float64)
    # an absent neighbour is treated as independent: a row and column of the identity
    among = torch.where(absent[:, :, None] | absent[:, None, :], torch.eye(near.shape[1], dtype=torch.float64), among)
    factor, failed = torch.linalg.cholesky_ex(among)
    if failed.any():
        raise UserError(
            f"map images near image {int(rows[failed.nonzero()[0, 0]])} have a singular covariance: the noise variance "
            f"{noise.item():.3g} is too small for images so close",
            "Raise kernel.noise_variance, or thin the map.",
        )
    weights = torch.cholesky_solve(cross[..., None], factor).squeeze(-1)
    expected = torch.einsum("bk,bkd->bd", weights, (descriptors[near] - mean).double())
    squared = ((descriptors[rows] - mean).double() - expected).square().sum(-1)
    variance = kernel.signal_variance + noise - (weights * cross).sum(-1)
    outputs = descriptors.shape[1]
    terms = -0.5 * (outputs * (2 * math.pi * variance).log() + squared / variance)
    value: Tensor = terms.sum() * (len(poses) / len(rows))
    return value
