r"""Vecchia's approximation of the marginal likelihood: each image is conditioned on a few near ones that precede it.

.. math:: \log p(Y) = \sum_i \log p(y_i \mid y_{1:i-1}) \approx \sum_i \log p(y_i \mid y_{N(i)}), \qquad
   N(i) = k \text{ nearest of } 1..i-1

Each term is a small regression, so a whole map costs O(n k³). A uniformly drawn minibatch B of rows, scaled by n / |B|,
is an unbiased estimate of the sum and of its gradient: 172,000 images train in constant memory. With k = n - 1 it is
the exact likelihood. It serves only to choose hyper-parameters; the local Gaussian process predicts by the same idea.

Neighbours among earlier images are found with one k-d tree for each prefix of 2^j images of the order. Row i of
[2^(j-1), 2^j) asks the tree of the first 2^j for its nearest images and keeps those before i, which are half of them
or more on average. Rows that got too few ask again for twice as many. The result is exact.

Sources: A. V. Vecchia, "Estimation and model identification for continuous spatial processes", JRSS B 1988;
M. Katzfuss and J. Guinness, "A general framework for Vecchia approximations of Gaussian processes", Statistical
Science 2021.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.localization.hyperparameters.trainable_kernel import TrainableKernel


@dataclass(frozen=True)
class Conditioning:
    """The images on which each image of a map is conditioned.

    Attributes:
        order: the images in the order of conditioning.
        neighbours: for image i of the map (not of the order), the images it is conditioned on, nearest first; -1 where
            fewer than k precede it.

    Example:
        >>> places = np.array([[0.0], [1.0], [3.0], [1.2]])
        >>> Conditioning.of(places, np.array([0, 2, 1, 3]), neighbours=1).neighbours.flatten()  # 1.2 by 1
        tensor([-1,  0,  0,  1])
    """

    order: Int64[Tensor, " n"]
    neighbours: Int64[Tensor, "n k"]

    @classmethod
    def of(cls, features: Float64[ndarray, "n f"], order: Int64[ndarray, " n"], neighbours: int) -> Self:
        """Condition each image on the nearest ``neighbours`` images that precede it.

        Args:
            features: points whose Euclidean distance says what is near, such as those of ``PoseKernel.features``.
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
    """The nearest ``neighbours`` rows that precede each row, nearest first; -1 where there are fewer."""
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
        >>> given_all = Conditioning.of(line.numpy(), np.arange(6), neighbours=5)  # on every image before
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
