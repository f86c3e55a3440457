r"""The log marginal likelihood of a Gaussian process whose D outputs share one kernel.

.. math:: \log p(Y) = -\tfrac12 \operatorname{tr}\!\big(\bar Y^\top K_y^{-1} \bar Y\big)
   - \tfrac{D}{2} \log|K_y| - \tfrac{ND}{2} \log 2\pi, \qquad K_y = K + \sigma_n^2 I,\ \bar Y = Y - \mathbf 1 m^\top

One Cholesky factorisation serves all outputs; D models of one output each would need D factorisations.

Source: C. E. Rasmussen and C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, equation 2.30.
"""

import math

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from sextant.errors import UserError
from sextant.localization.hyperparameters.trainable_kernel import TrainableKernel


def joint_log_likelihood(
    kernel: TrainableKernel,
    poses: Float[Tensor, "n 3"],
    descriptors: Float[Tensor, "n d"],
    mean: Float[Tensor, " d"],
) -> Float64[Tensor, ""]:
    """The log-likelihood of all descriptors in nats, differentiable in the kernel's parameters.

    Takes O(n³ + n²d) time and O(n²) memory, which suits a few thousand images. For more see
    :func:`~sextant.localization.hyperparameters.vecchia.vecchia_log_likelihood`.

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
        >>> poses = torch.tensor([[0.0, 0, 0], [100, 0, 0]], dtype=torch.float64)  # too far apart to tell of each other
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
