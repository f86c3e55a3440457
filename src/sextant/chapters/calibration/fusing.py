r"""Conversion of a photo's focal length and distortion to quantities that can be fused, and back to its camera.

With the longer side of the original as unit, photos of one camera, in any orientation and at any scale, share
:math:`\log f` and :math:`\hat k_1 = k_1 / f^2`. Their standard errors are half the 68 % intervals; with
:math:`f = 1 / (2 \tan(v / 2))` in image heights, :math:`|d \log f / d v| = (4 f^2 + 1) / (4 f)`.
"""

import math
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration import CameraBelief, PhotoPrior
from sextant.chapters.calibration.finding import LEVELS, Finding
from sextant.chapters.calibration.jointly import MULTIPLES, jointly, network_sigmas
from sextant.chapters.calibration.metrics.fusion import Fusion
from sextant.geometry import CameraParameters, k2_of_k1, rho_from_tilt, tilt_from_rho

#: standard error of values that are taken as known
CERTAIN = 1e-4


def estimate(finding: Finding) -> tuple[Float64[ndarray, "2"], Float64[ndarray, "2"]]:
    """Log focal length and k1_hat in units of the longer side, with standard errors: half the 68 % intervals."""
    focal, zoom = float(finding.camera.focal), finding.side / finding.view.height
    per_vfov = (4 * focal * focal + 1) / (4 * focal)  # |d ln f / d vfov|
    k1_hat = float(finding.camera.k1) / focal**2
    sigma_vfov, sigma_k1_hat = finding.half["68"][2:]
    sigmas = np.array([sigma_vfov * per_vfov, sigma_k1_hat * zoom**2])
    return np.array([math.log(focal / zoom), k1_hat * zoom**2]), np.maximum(sigmas, 1e-9)


def shared(finding: Finding) -> float:
    """Share of the information on the focal length that photos of one camera have in common: all but their lines.

    The prior and a network's bias are the same in every photo, so they count as one piece of evidence however many
    photos there are.
    """
    if finding.network is None:
        return 0.0
    focal = float(finding.network.camera.focal)
    network = network_sigmas(finding.network)[2] * (4 * focal * focal + 1) / (4 * focal)
    known = PhotoPrior.sigma[2] ** -2 + network**-2 * finding.trusts_network
    by_curvature = estimate(finding)[1][0] / MULTIPLES["68"][2]
    return float(min(known * by_curvature**2, 1.0))


def adopt(finding: Finding, fusion: Fusion, basis: str) -> Finding:
    """The finding with a fused focal length and distortion.

    Tilt and roll are estimated again with that lens, and their intervals include its uncertainty. For the network
    alone, roll is kept, and tilt is chosen such that the horizon keeps its position in the picture.
    """
    zoom = finding.side / finding.view.height
    old = finding.camera
    focal = torch.tensor(math.exp(fusion.values[0]) * zoom, dtype=torch.float64)
    k1 = fusion.values[1] / zoom**2 * focal.square()
    multiples = {name: np.array([multiple, multiple]) for name, (_, multiple) in LEVELS.items()}
    pose = finding.half
    if finding.network is not None:
        multiples = {name: MULTIPLES[name][2:] / MULTIPLES["68"][2:] for name in LEVELS}
        posed, longer = (
            jointly(finding, [_lens(float(f), float(k1 / focal.square() * f * f), finding)])
            for f in (focal, focal * math.exp(fusion.sigmas[0]))
        )
        tilt, roll = posed.camera.tilt, posed.camera.roll
        by_lens = np.array([float(longer.camera.tilt - tilt), float(longer.camera.roll - roll)])
        pose = {name: np.hypot(posed.half[name][:2], by_lens * multiples[name][0]) for name in LEVELS}
    else:
        rho = rho_from_tilt(old.tilt, old.focal, old.k1, finding.k2)
        tilt, roll = tilt_from_rho(rho, focal, k1, k2_of_k1(k1, finding.family)), old.roll
    per_log_focal = 4 * float(focal) / (4 * float(focal) ** 2 + 1)
    half = {}
    for name in LEVELS:
        fused = fusion.sigmas * multiples[name] * np.array([per_log_focal, zoom**-2])
        half[name] = np.concatenate([pose[name][:2], fused])
    alone = None if math.isfinite(fusion.prior_z) else finding.half
    return replace(
        finding, camera=CameraParameters(tilt, roll, focal, k1), half=half, basis=basis, alone=alone, joint=None
    )


def _lens(focal: float, k1: float, finding: Finding) -> CameraBelief:
    """A belief that fixes the lens, almost without uncertainty."""
    known = (math.inf, math.inf, CERTAIN, CERTAIN)
    return CameraBelief(0.0, 0.0, focal, k1 / focal**2, known, nu=math.inf, zoom=finding.zoom)
