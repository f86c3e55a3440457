r"""A kernel for telling the places of a map apart.

The likeliest kernel explains a map's descriptors, and treats as noise what distinguishes neighbouring places. A
localizer asks another question: at which pose was an image taken? Each image :math:`y_i` of the map is left out and
compared with what the others predict at every pose of the map,

.. math:: p(j \mid y_i) \propto e^{-b \lVert y_i - \mu_{-i}(x_j) \rVert^2}, \qquad
   L = \frac1n \sum_i \log \sum_{j:\, x_j = x_i} p(j \mid y_i),

with the largest L over b > 0. Predicted variances are left out: that of the place left out is the largest, and would
tell it. With :math:`P = K_y^{-1}` and :math:`\alpha = P \bar Y` all predictions follow from one factorisation:

.. math:: \mu_{-i}(x_i) = y_i - \alpha_i / P_{ii}, \qquad
   \mu_{-i}(x_j) = y_j - \sigma_n^2 \big(\alpha_j - P_{ji}\, \alpha_i / P_{ii}\big).

:func:`discriminative_kernel` chooses the lengths of x and y of the largest L, and keeps their ratio, the heading's
length and the signal's variance of the likeliest kernel. Noise is as small as covariances allow: below a hundredth of
the signal's variance L hardly changes, and above it falls.

Source: leave-one-out predictions are those of S. Sundararajan and S. S. Keerthi, "Predictive approaches for choosing
hyperparameters in Gaussian processes", Neural Computation 2001.
"""

import math

import numpy as np
import torch
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.localization.constants import NOISE
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.map_support import map_spacing
from sextant.localization.pose_kernel import PoseKernel

#: number of images, those nearest to the middle one: a sample of a larger area would have another spacing
IMAGES = 600
#: lengths that are tried: from a quarter of the map's spacing to four times it, four in each doubling
TRIED = 2.0 ** (np.arange(-8, 9) / 4)
#: b is sought within this factor (its logarithm) of the inverse of the median squared error, by so many bisections
RANGE, STEPS = 10.0, 16


def discriminative_kernel(kernel: PoseKernel, found: DescriptorMap) -> PoseKernel:
    """The kernel with the lengths and noise that tell the places of a map apart; itself for fewer than three images,
    and for images that are all alike.

    Args:
        kernel: the likeliest kernel of the map.
        found: the map.
    """
    near = _compact(found)
    if len(near) < 3:
        return kernel
    poses, residuals = found.poses[near], (found.descriptors[near] - found.mean).double()
    spacing, shorter = map_spacing(found.poses), min(kernel.length)
    tried = [kernel.sharpened(float(length * spacing / shorter), NOISE) for length in TRIED]
    told = [log_place_probability(each, poses, residuals) for each in tried]
    best = int(np.argmax(np.nan_to_num(told, nan=-np.inf)))
    return tried[best] if math.isfinite(told[best]) else kernel


def log_place_probability(
    kernel: PoseKernel, poses: Float64[Tensor, "n 3"], residuals: Float64[Tensor, "n d"]
) -> float:
    """L in nats; minus infinity if the covariance is singular to working precision. Takes O(n³ + n²d) time.

    Args:
        kernel: the kernel with its noise.
        poses: poses of the images.
        residuals: their descriptors less the mean.
    """
    apart = squared_errors(kernel, poses, residuals)
    if apart is None:
        return -math.inf
    same = (poses[:, None] == poses).all(2)
    told = (-_best_factor(apart, same) * apart).log_softmax(1)
    return float(told.masked_fill(~same, -torch.inf).logsumexp(1).mean())


def squared_errors(
    kernel: PoseKernel, poses: Float64[Tensor, "n 3"], residuals: Float64[Tensor, "n d"]
) -> Float64[Tensor, "n n"] | None:
    r""":math:`\lVert y_i - \mu_{-i}(x_j) \rVert^2` for images i and poses j; None if the covariance is singular."""
    noise, eye = kernel.noise_variance, torch.eye(len(poses), dtype=torch.float64)
    factor, failed = torch.linalg.cholesky_ex(kernel(poses, poses) + noise * eye)
    if failed:
        return None
    precision = torch.cholesky_inverse(factor)
    weights = precision @ residuals
    without = weights / precision.diagonal()[:, None]  # how far each image is off its own prediction
    mapped, changed, own = residuals - noise * weights, noise * precision, without.square().sum(1)
    squared = (
        residuals.square().sum(1)[:, None]
        + mapped.square().sum(1)
        + changed.square() * own[:, None]
        - 2 * residuals @ mapped.T
        - 2 * changed * ((residuals * without).sum(1)[:, None] - without @ mapped.T)
    )
    return torch.where(eye.bool(), own, squared).clamp(min=0.0)


def _compact(found: DescriptorMap) -> Tensor:
    """Rows of the images nearest to the middle one."""
    if len(found) <= IMAGES:
        return torch.arange(len(found))
    positions = found.poses[:, :2].numpy()
    return torch.from_numpy(np.sort(cKDTree(positions).query(positions[len(found) // 2], k=IMAGES)[1]))


def _best_factor(apart: Float64[Tensor, "n n"], same: Bool[Tensor, "n n"]) -> Float64[Tensor, ""]:
    """The b of the largest L. L is concave in b where each pose has one image: its slope is bisected."""
    middle = -apart.median().clamp(min=torch.finfo(apart.dtype).tiny).log()
    low, high = middle - RANGE, middle + RANGE
    for _ in range(STEPS):
        b = (low + high) / 2
        told = -b.exp() * apart
        rises = (told.softmax(1) * apart).sum(1) - (told.masked_fill(~same, -torch.inf).softmax(1) * apart).sum(1)
        low, high = (b, high) if rises.mean() > 0 else (low, b)
    return ((low + high) / 2).exp()
