r"""A photo's camera by all that is known of it: the network, lines, what people's cameras are, and what else was named.

Standard errors come from the curvature of the joint cost (:mod:`sextant.baselines.calibration.joint`). How often the
truth lies within a multiple of them was counted on real photos and panoramas, and :data:`MULTIPLES` are those that hold
68 and 95 % of these, averaged over their sources: a normal's would be 1 and 1.96, and real evidence has longer tails.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.calibration.finding import LEVELS, Finding
from sextant.baselines.calibration import CameraBelief, JointEstimate, PhotoPrior, Term, joint_estimate
from sextant.geometry import CameraParameters, vfov_from_focal

Method = Literal["joint", "lines", "network"]
#: by how much a network's errors of tilt, roll, vfov and k1_hat on photos of sources that it never saw exceed those
#: that it expects: rounded up from crops of 60 panoramas and 110 photos; more for vfov, in which it errs all one way,
#: the more the vaguer it is: at :data:`VAGUE` twice as much (radians)
NETWORK_SCALE = np.array([1.2, 1.2, 2.2, 4.0])
VAGUE = math.radians(8)
#: of the joint standard errors of tilt, roll, vfov and k1_hat, by level: counted on 273 photos and crops of nine
#: sources that trained no network, each source weighing as much as the root of its photos
#: (``python -m benchmarks.joint_intervals``)
MULTIPLES = {"68": np.array([1.4, 1.25, 0.85, 2.7]), "95": np.array([3.45, 4.3, 2.5, 10.8])}
#: standard deviation of a lens's principal point off the centre, longer sides: it turns the tilt
PRINCIPAL_POINT = 0.01
#: of tilt, roll and log focal, where a network has its own opinion of how people hold cameras, as sure as the usual
#: prior or surer; from half as sure on that prior is all there is
WIDE = (1.0, 0.2, 0.35)
#: long segments that point to an axis, below which no lens is measured by them, and those of each of two axes; the
#: probability of all but the best camera from which it is doubted
FEW, AN_AXIS, RIVALS = 10, 3, 0.2
#: standard errors between the network and the joint camera from which they disagree
DISAGREE = 3.0


def by_method(finding: Finding, method: Method) -> Finding:
    """What one method makes of a photo that was seen: all evidence, all but the network, or the network alone."""
    return finding if method == "network" else jointly(replace(finding, trusts_network=method == "joint"))


def jointly(finding: Finding, more: Sequence[Term] = ()) -> Finding:
    """The camera by the network's finding, the lines, the prior, and ``more`` that is known.

    Args:
        finding: of a photo whose lines were looked at; by the network, or jointly already.
        more: beliefs, in heights of the photo.
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
    if not more:  # else the lens is known, and does not rest on lines
        joint = joint.doubted(1, *_little(found))
    return joint.doubted(1, *_disagreements(said, joint)) if said.trusts_network else joint


def _held(network: CameraBelief) -> tuple[float, float, float]:
    """How far people's cameras are from level, beside a network: as ever where that says nothing."""
    usual = PhotoPrior.sigma
    tilt, roll = (
        wide - (wide - common) * min(max(said / common - 1, 0.0), 1.0)
        for wide, common, said in zip(WIDE[:2], usual[:2], network.sigma[:2], strict=True)
    )
    return tilt, roll, WIDE[2]


def network_belief(said: Finding) -> CameraBelief:
    """What the network says, with errors as it makes them on real photos; larger where a photo looks strange to it."""
    camera = said.camera
    tilt, roll, vfov, k1_hat = map(float, max(1.0, said.strangeness) * network_sigmas(said))
    return CameraBelief(
        float(camera.tilt), float(camera.roll), float(camera.focal), float(camera.k1 / camera.focal.square()),
        (tilt, roll, vfov, k1_hat), zoom=said.zoom,
    )  # fmt: skip


def network_sigmas(said: Finding) -> Float64[ndarray, "4"]:
    """Standard errors of what the network says of tilt, roll, vfov (radians) and k1_hat, as it makes them on photos."""
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
    """Where the lens rests on too few lines, or on two opinions."""
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
    """Where the network is far off what lines and priors made of the photo."""
    off = [said.camera.tilt - joint.camera.tilt, said.camera.roll - joint.camera.roll]
    off.append(vfov_from_focal(said.camera.focal) - vfov_from_focal(joint.camera.focal))
    sigmas = network_sigmas(said)[:3]
    far = [
        f"{name} by {abs(math.degrees(float(each))):.0f}°"
        for name, each, sigma in zip(("tilt", "roll", "field of view"), off, sigmas, strict=True)
        if abs(float(each)) > DISAGREE * sigma
    ]
    return [f"the network and the lines disagree: {', '.join(far)}"] if far else []
