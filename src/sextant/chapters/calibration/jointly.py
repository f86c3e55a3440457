r"""A photo's camera from all evidence: the network, lines, a prior over people's cameras, and any named prior.

Standard errors come from the curvature of the joint cost (:mod:`sextant.baselines.calibration.joint`). How often the
truth lies within a multiple of them was counted on real photos and panoramas. :data:`MULTIPLES` are those that hold 68
and 95 % of these, averaged over their sources. Under a normal distribution they would be 1 and 1.96; real evidence has
longer tails.
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
from sextant.chapters.calibration.finding import LEVELS, Finding
from sextant.geometry import CameraParameters, vfov_from_focal

Method = Literal["joint", "lines", "network"]
#: factors by which a network's errors of tilt, roll, vfov and k1_hat exceed those that it expects, on photos of sources
#: that it never saw: rounded up from crops of 60 panoramas and 110 photos. That of vfov grows with the width of its
#: interval, since these errors are all in one direction: at :data:`VAGUE` (radians) it is twice as large
NETWORK_SCALE = np.array([1.2, 1.2, 2.2, 4.0])
VAGUE = math.radians(8)
#: multiples of the joint standard errors of tilt, roll, vfov and k1_hat, by level: counted on 273 photos and crops of
#: nine sources that trained no network, each source weighted by the root of its number of photos
#: (``python -m benchmarks.joint_intervals``)
MULTIPLES = {"68": np.array([1.4, 1.25, 0.85, 2.7]), "95": np.array([3.45, 4.3, 2.5, 10.8])}
#: standard deviation of a lens's principal point from the centre, in longer sides; it turns the tilt
PRINCIPAL_POINT = 0.01
#: standard deviations of the prior of tilt, roll and log focal length beside a network that is at least as sure as the
#: usual prior, since it has its own opinion of how people hold cameras; for tilt and roll, the usual prior takes over
#: until the network is half as sure
WIDE = (1.0, 0.2, 0.35)
#: least number of long segments that point to an axis for a lens to be measured by them, and least number for each of
#: two axes; the probability of all cameras but the best above which it is doubted
FEW, AN_AXIS, RIVALS = 10, 3, 0.2
#: standard errors between the network and the joint camera above which they disagree
DISAGREE = 3.0


def by_method(finding: Finding, method: Method) -> Finding:
    """The finding by one method: all evidence, all but the network, or the network alone."""
    return finding if method == "network" else jointly(replace(finding, trusts_network=method == "joint"))


def jointly(finding: Finding, more: Sequence[Term] = ()) -> Finding:
    """The camera given the network's finding, the lines, the prior, and ``more`` that is known.

    Args:
        finding: finding of a photo whose lines were looked at; by the network, or jointly already.
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
    joint = _adopted(said, found, longer)
    if found.ends:
        joint = joint.doubted(1, f"at an end of what is searched: {', '.join(found.ends)}; the truth may lie beyond")
    if not more:  # otherwise the lens is known, and does not rest on lines
        joint = joint.doubted(1, *_little(found))
    return joint.doubted(1, *_disagreements(said, joint)) if said.trusts_network else joint


def _held(network: CameraBelief) -> tuple[float, float, float]:
    """Standard deviations of the prior of people's cameras beside a network: the usual ones where it says nothing."""
    usual = PhotoPrior.sigma
    tilt, roll = (
        wide - (wide - common) * min(max(said / common - 1, 0.0), 1.0)
        for wide, common, said in zip(WIDE[:2], usual[:2], network.sigma[:2], strict=True)
    )
    return tilt, roll, WIDE[2]


def network_belief(said: Finding) -> CameraBelief:
    """The network's prediction, with its errors on real photos; larger where a photo looks strange to it."""
    camera = said.camera
    tilt, roll, vfov, k1_hat = map(float, max(1.0, said.strangeness) * network_sigmas(said))
    return CameraBelief(
        float(camera.tilt), float(camera.roll), float(camera.focal), float(camera.k1 / camera.focal.square()),
        (tilt, roll, vfov, k1_hat), zoom=said.zoom,
    )  # fmt: skip


def network_sigmas(said: Finding) -> Float64[ndarray, "4"]:
    """Standard errors of the network's tilt, roll, vfov (radians) and k1_hat, as on real photos."""
    sigmas = NETWORK_SCALE * said.half["68"]
    return np.asarray(sigmas * [1, 1, 1 + said.half["68"][2] / VAGUE, 1])


def _adopted(said: Finding, found: JointEstimate, longer: float) -> Finding:
    tilt, roll, log_focal, k1_hat = found.vector
    if not np.isfinite(found.vector).all():
        raise ArithmeticError("the search for its camera ended nowhere")
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
    """Doubts where the lens rests on too few lines, or where two cameras are nearly as likely."""
    doubts = []
    if found.support.sum() < FEW or (found.support >= AN_AXIS).sum() < 2:
        doubts.append(
            f"few lines tell the lens: {'+'.join(map(str, found.support))} long segments point to the three axes, "
            f"fewer than {FEW}, or to fewer than two of them"
        )
    if found.rivals > RIVALS:
        doubts.append(f"another camera suits the photo nearly as well: its probability is {found.rivals:.0%}")
    return doubts


def _disagreements(said: Finding, joint: Finding) -> list[str]:
    """Doubts where the network is far from what lines and priors made of the photo."""
    off = [said.camera.tilt - joint.camera.tilt, said.camera.roll - joint.camera.roll]
    off.append(vfov_from_focal(said.camera.focal) - vfov_from_focal(joint.camera.focal))
    sigmas = network_sigmas(said)[:3]
    far = [
        f"{name} by {abs(math.degrees(float(each))):.0f}°"
        for name, each, sigma in zip(("tilt", "roll", "field of view"), off, sigmas, strict=True)
        if abs(float(each)) > DISAGREE * sigma
    ]
    return [f"the network and the lines disagree: {', '.join(far)}"] if far else []
