"""What the labels of training images say about a camera that has not been seen yet."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration.estimate import CameraPrior
from sextant.geometry import CameraParameters

#: The median absolute deviation of a Gaussian is 1 / 1.4826 of its standard deviation.
MAD_TO_SIGMA = 1.4826


def prior_of_cameras(cameras: CameraParameters, *, level: bool = False) -> CameraPrior:
    """The belief that training labels justify: their medians and spreads (1.48 median absolute deviations).

    Args:
        cameras: a batch.
        level: means of tilt, roll and k1_hat are 0 rather than medians; the spreads are then about 0.

    Raises:
        ValueError: there is no camera.

    Example:
        >>> import torch
        >>> tilt, zero = torch.tensor([0.1, 0.2, 0.3]), torch.zeros(3)
        >>> prior = prior_of_cameras(CameraParameters(tilt, roll=zero, focal=zero + 1, k1=zero))
        >>> round(prior.tilt, 4), round(prior.sigma[0], 4), prior.sigma[1]  # 1.4826 · 0.1; what never varies has 0.001
        (0.2, 0.1483, 0.001)
    """
    values = _beliefs(cameras)
    centre = np.median(values, axis=0)
    if level:
        centre[[0, 1, 3]] = 0
    spread = MAD_TO_SIGMA * np.median(np.abs(values - centre), axis=0)
    # constant labels leave no spread, heavy tails (roll) too little: the second moment helps with both
    spread = np.maximum(spread, 0.5 * np.sqrt(np.mean((values - centre) ** 2, axis=0)))
    return CameraPrior.of_vector(centre, np.maximum(spread, 1e-3))


def _beliefs(cameras: CameraParameters) -> Float64[ndarray, "n 4"]:
    tilt, roll, focal, k1 = (np.atleast_1d(value.double().cpu().numpy()) for value in cameras)
    if tilt.size == 0:
        raise ValueError("need at least one camera to learn a prior from")
    return np.stack([tilt, roll, np.log(focal), k1 / focal**2], axis=-1)
