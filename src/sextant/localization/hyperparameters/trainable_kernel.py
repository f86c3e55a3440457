r"""A kernel over poses with trainable parameters, built from GPyTorch's kernels.

.. math:: k(a, b) = \sigma_f^2\, g\!\left(\sqrt{\tfrac{\Delta x^2}{\ell_x^2} + \tfrac{\Delta y^2}{\ell_y^2}}\right)
   e^{-(1 - \cos\Delta\theta) / \ell_\theta^2}

with g the RBF or a Matérn. GPyTorch's ``PeriodicKernel`` of period 2π is
:math:`e^{-2\sin^2(\Delta\theta/2)/\lambda} = e^{-(1-\cos\Delta\theta)/\lambda}`: its :math:`\lambda`, which it calls a
length, is :math:`\ell_\theta^2`. The logarithms of parameters are trained, so that a step is relative and does not
depend on the unit of positions or descriptors. Everything is float64, as covariance matrices of closely spaced images
are nearly singular.
"""

import math
from typing import Self

import numpy as np
import torch
from gpytorch.constraints import GreaterThan, Interval
from gpytorch.kernels import Kernel, MaternKernel, PeriodicKernel, RBFKernel, ScaleKernel
from jaxtyping import Float, Float32, Float64
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.localization.hyperparameters._spread import mean_variance, nearest_distance
from sextant.localization.pose_kernel import PoseKernel, Spatial

#: Starting values: lengths in nearest distances between map images, the noise as a share of the descriptors' variance.
STEPS_OF_LENGTH = 4.0
NOISE_SHARE = 0.2
#: In rad: views turned by 40 degrees share about half of what they see.
HEADING_LENGTH = 0.7
#: The noise never falls below this share of its starting value, so that the factorisation stays possible.
LEAST_NOISE = 1e-4
#: share of the descriptors' mean square below which their variance is due to rounding
ROUNDING = 1e-10
SMOOTHNESS = {"matern32": 1.5, "matern52": 2.5}


class TrainableKernel(nn.Module):
    """A :class:`~sextant.localization.pose_kernel.PoseKernel` to be trained by gradients.

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
            UserError: the descriptors are all equal.
            ValueError: there are no poses, or not one descriptor for each.
        """
        if not len(poses) or len(poses) != len(descriptors):
            raise ValueError(f"need a descriptor for each pose; got {len(descriptors)} for {len(poses)}")
        variance = mean_variance(descriptors)
        if not variance > ROUNDING * float(descriptors.double().square().mean()):
            raise UserError(
                f"the map's {len(poses)} descriptors are all equal, so its places cannot be told apart",
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
