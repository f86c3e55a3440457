"""Cholesky factors of the covariance of map poses, and variances that rounding cannot make negative."""

import torch
from torch import Tensor

from sextant.errors import UserError
from sextant.localization.pose_kernel import PoseKernel

#: Smallest variance of the signal, as a share of its prior variance: the level of rounding errors.
LEAST = 1e-12


def noisy_factor(covariance: Tensor, noise_variance: float) -> Tensor:
    """The lower Cholesky factor of ``covariance + noise_variance I``, batched; changes the diagonal of ``covariance``.

    Raises:
        UserError: the sum is not positive definite, as when there is no noise and poses nearly coincide.
    """
    covariance.diagonal(dim1=-2, dim2=-1).add_(noise_variance)
    factor: Tensor
    factor, failed = torch.linalg.cholesky_ex(covariance)
    if bool(failed.any()):
        raise UserError(
            f"with kernel.noise_variance={noise_variance} the covariance of the map's poses is not positive definite: "
            "some poses are too close together to be distinguished",
            "Raise kernel.noise_variance (1e-6 of its signal_variance is enough), or thin the map.",
        )
    return factor


def noisy_variance(kernel: PoseKernel, explained: Tensor) -> Tensor:
    """Variance of an observation where ``explained`` of the signal's variance is known from the map."""
    left = (kernel.signal_variance - explained).clamp_min(LEAST * kernel.signal_variance)
    noisy: Tensor = left + kernel.noise_variance
    return noisy


def check_noise(kernel: PoseKernel, name: str) -> None:
    """Raise a ``UserError`` if the kernel has no noise, which the model of that name divides by."""
    if not kernel.noise_variance > 0:
        raise UserError(
            f"kernel.noise_variance={kernel.noise_variance} must be above 0 for {name}",
            "Train the kernel, or set a noise variance of a few per cent of the signal variance.",
        )
