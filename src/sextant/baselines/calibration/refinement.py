r"""Refinement of a network's calibration by the lines of the image: its estimate is the prior of a geometric fit.

The maximum of the posterior under the network's Gaussian belief and the segments' Cauchy residuals of
:mod:`~sextant.baselines.calibration.manhattan`. Where the image has no lines, or none that three orthogonal axes near
the network's camera explain, the posterior is the belief.
"""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.combined import detect_bent_segments
from sextant.baselines.calibration.edge_chains import detect_chains
from sextant.baselines.calibration.estimate import CalibrationEstimate, CameraPrior
from sextant.baselines.calibration.line_segments import count_long
from sextant.baselines.calibration.manhattan import BELIEFS, FIRST_ROUND, THRESHOLD, fit_manhattan, sines
from sextant.baselines.calibration.plumb_line import straightening_k1_hat
from sextant.geometry import CameraParameters

#: Headings that are tried: a Manhattan frame repeats after a right angle.
HEADINGS = np.radians(np.arange(-45, 45, 2.0))
#: Headings that are refined.
REFINED = 3


def refine(
    image: UInt8[ndarray, "h w 3"], initial: CameraParameters, sigma: CameraParameters, *, use_chains: bool = True
) -> CalibrationEstimate:
    """The camera that took ``image``, given a first estimate and its uncertainty.

    Args:
        image: RGB.
        initial: one camera, tensors without dimensions.
        sigma: standard deviations of tilt and roll (radians), of the focal length (image heights) and of k1; that of k1
            is divided by the squared focal length and taken as the one of the apparent distortion.
        use_chains: whether bent chains of edge pixels sharpen the distortion first.

    Raises:
        UserError: a value is not finite, or a standard deviation is not above 0.
    """
    belief = _belief(initial, sigma)
    sharper = belief
    if use_chains:
        k1_hat, spread = straightening_k1_hat(detect_chains(image), belief)
        sharper = replace(belief, k1_hat=k1_hat, sigma=(*belief.sigma[:3], spread))
    segments = detect_bent_segments(image, sharper.k1_hat, sharper.focal)
    if len(segments) == 0:
        return CalibrationEstimate.of_vector(sharper.vector, np.diag(np.square(sharper.sigma)), belief, 0)
    rough = [
        fit_manhattan(segments, s, sharper, bent=False, thresholds=FIRST_ROUND) for s in _starts(segments, sharper)
    ]
    fitted = fit_manhattan(segments, min(rough, key=lambda fit: fit.cost).vector, sharper, bent=True)
    covariance = fitted.covariance[np.ix_(BELIEFS, BELIEFS)]
    return CalibrationEstimate.of_vector(fitted.vector[BELIEFS], covariance, belief, count_long(segments))


def _belief(initial: CameraParameters, sigma: CameraParameters) -> CameraPrior:
    """The Gaussian belief in tilt, roll, log focal and k1_hat."""
    tilt, roll, focal, k1 = (float(torch.as_tensor(value)) for value in initial)
    s_tilt, s_roll, s_focal, s_k1 = (float(torch.as_tensor(value)) for value in sigma)
    return CameraPrior(tilt, roll, focal, k1 / focal**2, (s_tilt, s_roll, s_focal / focal, s_k1 / focal**2))


def _starts(segments: Float64[ndarray, "n 2 2"], belief: CameraPrior) -> list[Float64[ndarray, "5"]]:
    """The belief's camera with the headings that explain most segments, apart from each other."""
    tilt, roll, log_focal, k1_hat = belief.vector
    vectors = np.array([[tilt, roll, heading, log_focal, k1_hat] for heading in HEADINGS])
    nearest = np.abs(sines(vectors, segments)).min(axis=1)
    score = np.minimum(nearest / np.sin(2 * THRESHOLD), 1).sum(axis=1)
    local = (score <= np.roll(score, 1)) & (score <= np.roll(score, -1))
    return [vectors[index] for index in np.argsort(np.where(local, score, np.inf), kind="stable")[:REFINED]]
