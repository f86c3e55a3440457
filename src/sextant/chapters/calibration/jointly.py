r"""A photo's camera from all evidence: the network, lines, a prior on typical cameras, and any known values.

Standard errors come from the curvature of the joint cost (:mod:`sextant.baselines.calibration.joint`).
:data:`MULTIPLES` of them were calibrated on real photos and panoramas, averaged over their sources, to cover the truth
in 68 and 95 % of cases. Under a normal distribution they would be 1 and 1.96; real errors have longer tails.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.baselines.calibration import CameraBelief, JointEstimate, PhotoPrior, Term, joint_estimate
from sextant.chapters.calibration.finding import LEVELS, STUDENT, Finding
from sextant.geometry import CameraParameters, vfov_from_focal

Method = Literal["joint", "lines", "network"]
#: factors by which a network's errors of tilt, roll, vfov and k1_hat exceed those that it expects, on photos of sources
#: not in its training set: rounded up from crops of 60 panoramas and 110 photos. That of vfov grows with the width of
#: its interval, since these errors are all in one direction: at :data:`VAGUE` (radians) it is twice as large
NETWORK_SCALE = np.array([1.2, 1.2, 2.2, 4.0])
VAGUE = math.radians(8)
#: multiples of the joint standard errors of tilt, roll, vfov and k1_hat, by level: calibrated on 273 photos and crops
#: of nine sources not used in training, each weighted by the root of its number of photos
#: (``python -m benchmarks.joint_intervals``)
MULTIPLES = {"68": np.array([1.4, 1.25, 0.85, 2.7]), "95": np.array([3.45, 4.3, 2.5, 10.8])}
#: standard deviation of a lens's principal point from the centre, in longer sides; it adds to the uncertainty of tilt
PRINCIPAL_POINT = 0.01
#: standard deviations of the prior of tilt, roll and log focal length beside a network at most as uncertain as the
#: usual prior, since its training already covers how cameras are held; for tilt and roll they fall to the usual ones
#: as the network's standard error grows to twice these
WIDE = (1.0, 0.2, 0.35)
#: fewest long segments along the axes, and along each of two axes, that determine a lens; probability of all cameras
#: but the best above which the best is doubted
FEW, AN_AXIS, RIVALS = 10, 3, 0.2
#: standard errors between the network and the joint camera above which they disagree
DISAGREE = 3.0


def by_method(finding: Finding, method: Method) -> Finding:
    """The finding by one method: all evidence, all but the network, or the network alone."""
    return finding if method == "network" else jointly(replace(finding, trusts_network=method == "joint"))


def jointly(finding: Finding, more: Sequence[Term] = ()) -> Finding:
    """The camera given the network's finding, the lines, the prior and ``more`` beliefs.

    Args:
        finding: of a photo whose lines were detected; by the network alone, or already joint.
        more: further beliefs, in heights of the photo.
    """
    said = replace(finding.network or finding, gravity=finding.gravity)
    assert said.lines is not None
    longer = said.lines.longer
    beliefs: list[Term] = [PhotoPrior(longer)]
    if said.trusts_network:
        beliefs = [network := network_belief(said), PhotoPrior(longer, _held(network))]
    down = [said.gravity] if said.gravity else []
    found = joint_estimate(said.lines, [*beliefs, *down, *more])
    alone = said.trusts_network and not (said.of_others or down or more)
    joint = replace(_adopted(said, found, longer), joint=found if alone else None)
    if found.ends:
        joint = joint.doubted(
            1, f"at an end of the search range: {', '.join(found.ends)}; the true value may lie beyond"
        )
    if not more:  # otherwise the lens is known, and does not depend on the lines
        joint = joint.doubted(1, *_little(found), modelled=True)
    if alone:  # otherwise gravity may be known, and verdicts by widths heed few lines only
        joint = joint.doubted(1, *_no_axes(found), modelled=True)
    return joint.doubted(1, *_disagreements(said, joint), modelled=True) if said.trusts_network else joint


def _held(network: CameraBelief) -> tuple[float, float, float]:
    """Standard deviations of the camera prior beside a network: the usual ones where it is uninformative."""
    usual = PhotoPrior.sigma
    tilt, roll = (
        wide - (wide - common) * min(max(said / common - 1, 0.0), 1.0)
        for wide, common, said in zip(WIDE[:2], usual[:2], network.sigma[:2], strict=True)
    )
    return tilt, roll, WIDE[2]


def network_belief(said: Finding) -> CameraBelief:
    """The network's prediction with its errors on real photos, larger where a photo is unlike its training images."""
    camera = said.camera
    tilt, roll, vfov, k1_hat = map(float, max(1.0, said.strangeness) * network_sigmas(said))
    return CameraBelief(
        float(camera.tilt), float(camera.roll), float(camera.focal), float(camera.k1 / camera.focal.square()),
        (tilt, roll, vfov, k1_hat), zoom=said.zoom,
    )  # fmt: skip


def network_sigmas(said: Finding) -> Float64[ndarray, "4"]:
    """Standard errors of the network's tilt, roll, vfov (radians) and k1_hat, as on real photos."""
    if said.of_others:
        return said.half["68"] / STUDENT["68"]
    sigmas = NETWORK_SCALE * said.half["68"]
    return np.asarray(sigmas * [1, 1, 1 + said.half["68"][2] / VAGUE, 1])


def _adopted(said: Finding, found: JointEstimate, longer: float) -> Finding:
    tilt, roll, log_focal, k1_hat = found.vector
    if not np.isfinite(found.vector).all():
        raise ArithmeticError("the search for its camera did not converge")
    focal = math.exp(log_focal) / said.zoom
    k1_hat *= said.zoom**2
    per_log_focal = 4 * focal / (4 * focal**2 + 1)  # |d vfov / d ln f|
    variance = np.diag(found.covariance)
    sigma = np.sqrt(np.where(variance > 0, variance, np.inf)) * [1, 1, per_log_focal, said.zoom**2]
    sigma[0] = math.hypot(sigma[0], PRINCIPAL_POINT * longer / math.exp(log_focal))
    half = {level: MULTIPLES[level] * sigma for level in LEVELS}
    camera = CameraParameters(*torch.tensor([tilt, roll, focal, k1_hat * focal**2], dtype=torch.float64).unbind())
    return replace(
        said, camera=camera, half=half, basis="joint cost, calibrated on real photos", network=said, family="lopez"
    )


def _little(found: JointEstimate) -> list[str]:
    """Doubts where the lens rests on too few lines or no axes, or where two cameras are nearly as likely."""
    doubts = []
    if found.support.sum() < FEW or (found.support >= AN_AXIS).sum() < 2:
        doubts.append(
            f"few lines constrain the lens: {'+'.join(map(str, found.support))} long segments along the three axes, "
            f"fewer than {FEW} in all or too few along two of them"
        )
    if found.rivals > RIVALS:
        doubts.append(f"another camera fits the photo nearly as well, with a probability of {found.rivals:.0%}")
    return doubts


def _no_axes(found: JointEstimate) -> list[str]:
    """That the lines have no frame, or nothing vertical."""
    if (found.support < AN_AXIS).all():
        return [f"no frame: along none of three axes are there {AN_AXIS} long segments"]
    return [] if found.support[1] else ["no vertical axis: no long segment points up or down"]


def _disagreements(said: Finding, joint: Finding) -> list[str]:
    """Doubts where the network's prediction is far from the joint estimate."""
    off = [said.camera.tilt - joint.camera.tilt, said.camera.roll - joint.camera.roll]
    off.append(vfov_from_focal(said.camera.focal) - vfov_from_focal(joint.camera.focal))
    sigmas = network_sigmas(said)[:3]
    far = [
        f"{name} by {abs(math.degrees(float(each))):.0f}°"
        for name, each, sigma in zip(("tilt", "roll", "field of view"), off, sigmas, strict=True)
        if abs(float(each)) > DISAGREE * sigma
    ]
    return [f"the network and the lines disagree: {', '.join(far)}"] if far else []
