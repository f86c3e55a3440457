r"""A regular grid over poses, cubic interpolation from it, and products with the kernel on it.

The RBF kernel on positions and the factor of the heading form a product over the dimensions, so on a grid
:math:`K_G = s_f^2\, K_x \otimes K_y \otimes K_\theta`. The axis of the heading is the evenly divided circle: its
weights wrap, and :math:`K_\theta` is a circulant of a kernel that is positive definite on the circle. A grid over
(cos θ, sin θ) would spend another dimension, 256 weights a pose instead of 64, on points off the circle; one over an
interval of angles would break at its ends. A dimension in which the map does not vary gets no axis: its factor
:math:`k_d(x_d, x_d^{map})` is the same for every image of the map, and so is kept exact.

Source of the interpolation: R. Keys, "Cubic convolution interpolation for digital image processing", IEEE TASSP 1981.
"""

import math
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import torch
from jaxtyping import Float64
from linear_operator.utils.toeplitz import sym_toeplitz_matmul
from numpy import ndarray
from scipy.sparse import csr_array
from torch import Tensor

from sextant.localization.pose_kernel import PoseKernel

#: Kernel lengths by which the grid extends beyond the map: there the kernel has fallen to 1 %.
MARGIN = 3.0
#: A dimension whose extent is below this share of its length does not vary.
FLAT = 1e-9
#: Smallest number of divisions of the circle: four weights on different nodes, and one to spare.
LEAST_AROUND = 5
#: Number of nodes up to which the matrix of an axis is built.
DENSE = 1024


@dataclass(frozen=True)
class Axis:
    """Evenly spaced nodes in one dimension of the pose.

    Attributes:
        dimension: 0, 1 or 2 for x, y or heading.
        start: value of the first node.
        step: distance from node to node.
        nodes: number of nodes.
        kernel: kernel over poses, whose factor in this dimension is used.
    """

    dimension: int
    start: float
    step: float
    nodes: int
    kernel: PoseKernel

    @property
    def wraps(self) -> bool:
        """Whether the last node is followed by the first."""
        return self.dimension == 2

    @cached_property
    def column(self) -> Float64[Tensor, " g"]:
        """The factor between the first node and all, the first column of the symmetric Toeplitz matrix of all pairs."""
        return factor_of_dimension(
            self.step * torch.arange(self.nodes, dtype=torch.float64), self.dimension, self.kernel
        )

    def times_kernel(self, columns: Float64[Tensor, "g c"]) -> Float64[Tensor, "g c"]:
        """The matrix times some columns: directly if it is small, otherwise by Fourier transforms."""
        if self.nodes > DENSE:
            product: Tensor = sym_toeplitz_matmul(self.column, columns)
            return product
        return self._matrix @ columns

    @cached_property
    def _matrix(self) -> Tensor:
        apart = torch.arange(self.nodes)
        return self.column[(apart[:, None] - apart).abs()]

    def interpolated_variance(self, weights: Float64[ndarray, "n 4"]) -> Float64[ndarray, " n"]:
        """The interpolated factor between a value and itself, whose exact value is 1."""
        apart = np.arange(4)
        local = self.column.numpy()[np.abs(apart[:, None] - apart)]
        variance: ndarray = np.einsum("ni,ij,nj->n", weights, local, weights)
        return variance

    def interpolation(self, values: Float64[ndarray, " n"]) -> tuple[ndarray, ndarray, ndarray]:
        """The four nodes around each value, their weights, and whether the value lies within the axis."""
        along = (values - self.start) / self.step
        before = np.floor(along)
        near = before[:, None].astype(np.int64) + np.arange(-1, 3)
        weights = _keys(np.abs((along - before)[:, None] - np.arange(-1, 3)))
        if self.wraps:
            return near % self.nodes, weights, np.ones(len(values), dtype=bool)
        inside = (near[:, 0] >= 0) & (near[:, -1] < self.nodes)
        return near.clip(0, self.nodes - 1), weights, inside


@dataclass(frozen=True)
class PoseGrid:
    """The axes in which a map varies.

    Attributes:
        axes: one for each such dimension.
        kernel: RBF on positions.
        origin: the pose of an image of the map, for the dimensions without an axis.
    """

    axes: tuple[Axis, ...]
    kernel: PoseKernel
    origin: Float64[Tensor, "3"]

    @classmethod
    def of(cls, poses: Float64[Tensor, "n 3"], kernel: PoseKernel, spacing: float) -> "PoseGrid":
        """A grid over the map's poses with nodes every ``spacing`` lengths of the kernel."""
        axes = [_straight_axis(poses[:, d], d, kernel, spacing) for d in (0, 1)]
        turns = torch.remainder(poses[:, 2] - poses[0, 2] + math.pi, 2 * math.pi) - math.pi
        axes.append(None if float(turns.abs().max()) < FLAT else _circle(kernel, spacing))
        return cls(tuple(axis for axis in axes if axis is not None), kernel, poses[0].clone())

    @property
    def nodes(self) -> int:
        """The number of nodes of the whole grid; 1 if the map is a single pose."""
        return math.prod(axis.nodes for axis in self.axes)

    def interpolation(self, poses: Float64[Tensor, "n 3"]) -> tuple[csr_array, Float64[Tensor, " n"]]:
        r"""Weights W of shape (n, nodes), and the prior variance :math:`w^\top K_G w` of each pose that they imply.

        For dimensions without an axis W holds their exact factor. Poses beyond the grid have zero weights and the
        kernel's own variance.
        """
        n = len(poses)
        columns = np.zeros((n, 1), dtype=np.int64)
        values = self._exact_factor(poses)[:, None].numpy()
        variance = np.full(n, self.kernel.signal_variance)
        inside = np.ones(n, dtype=bool)
        for axis in self.axes:
            near, weights, within = axis.interpolation(poses[:, axis.dimension].numpy())
            width = 4 * columns.shape[1]
            columns = (columns[:, :, None] * axis.nodes + near[:, None, :]).reshape(n, width)
            values = (values[:, :, None] * weights[:, None, :]).reshape(n, width)
            variance *= axis.interpolated_variance(weights)
            inside &= within
        values = np.where(inside[:, None], values, 0.0)
        starts = np.arange(n + 1) * columns.shape[1]
        matrix = csr_array((values.ravel(), columns.ravel(), starts), shape=(n, self.nodes))
        return matrix, torch.from_numpy(np.where(inside, variance, self.kernel.signal_variance))

    def times_kernel(self, values: Float64[ndarray, "g c"]) -> Float64[ndarray, "g c"]:
        """The kernel on the grid times some columns, axis by axis."""
        product = torch.from_numpy(values).view(*(axis.nodes for axis in self.axes), -1)
        for place, axis in enumerate(self.axes):
            first = product.movedim(place, 0)
            product = axis.times_kernel(first.reshape(axis.nodes, -1)).view(first.shape).movedim(0, place)
        result: ndarray = (self.kernel.signal_variance * product).reshape(values.shape).numpy()
        return result

    def _exact_factor(self, poses: Tensor) -> Tensor:
        with_axis = {axis.dimension for axis in self.axes}
        absent = [d for d in range(3) if d not in with_axis]
        factors = [factor_of_dimension(poses[:, d] - self.origin[d], d, self.kernel) for d in absent]
        return reduce(torch.mul, factors, poses.new_ones(len(poses)))


def factor_of_dimension(difference: Float64[Tensor, " n"], dimension: int, kernel: PoseKernel) -> Float64[Tensor, " n"]:
    """The factor of an RBF kernel for one dimension of the pose, without the signal variance."""
    if dimension == 2:
        return torch.exp((difference.cos() - 1) / kernel.heading_length**2)
    return torch.exp(-0.5 * (difference / kernel.length[dimension]).square())


def _straight_axis(values: Tensor, dimension: int, kernel: PoseKernel, spacing: float) -> Axis | None:
    low, high, length = float(values.min()), float(values.max()), kernel.length[dimension]
    if high - low < FLAT * length:
        return None
    step = spacing * length
    start = low - MARGIN * length - step
    nodes = math.ceil((high + MARGIN * length - start) / step) + 2
    return Axis(dimension, start, step, nodes, kernel)


def _circle(kernel: PoseKernel, spacing: float) -> Axis:
    nodes = max(LEAST_AROUND, math.ceil(2 * math.pi / (spacing * kernel.heading_length)))
    return Axis(2, 0.0, 2 * math.pi / nodes, nodes, kernel)


def _keys(distance: ndarray) -> ndarray:
    """Keys' cubic kernel, for a distance in [0, 2] in steps."""
    near = (1.5 * distance - 2.5) * distance**2 + 1
    far = ((-0.5 * distance + 2.5) * distance - 4) * distance + 2
    weights: ndarray = np.where(distance <= 1, near, far)
    return weights
