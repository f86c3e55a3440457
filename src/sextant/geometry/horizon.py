r"""The horizon in an image: its offset from the image centre, τ without distortion and ρ with it.

For tilt θ and roll ψ, the horizon without distortion is the line :math:`u\sin\psi + v\cos\psi = \tau`, with
:math:`\tau = f\tan\theta`. Distortion moves points along rays from the centre and keeps their order, so the point of
the distorted horizon that is nearest to the centre, its *foot*, is :math:`\rho(\sin\psi, \cos\psi)`. It is not the
crossing with the vertical centre line. Offsets are in image heights, positive below the centre (θ > 0: looking up).

Source: M. Lopez-Antequera et al., "Deep single image camera calibration with radial distortion", CVPR 2019, section 3.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.geometry.camera import Camera
from sextant.geometry.distortion import distort_radius, undistort_radius
from sextant.geometry.rotations import rotation_from_tilt_roll


def tau_from_tilt(tilt: Float[Tensor, "*#batch"], focal: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch"]:
    """Undistorted offset ``τ = f tan θ`` of the horizon, in image heights, for tilt (radians) in (-π/2, π/2).

    >>> tau_from_tilt(torch.deg2rad(torch.tensor(10.0)), torch.tensor(1.2))
    tensor(0.2116)
    """
    return focal * torch.tan(tilt)


def tilt_from_tau(tau: Float[Tensor, "*#batch"], focal: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch"]:
    """Tilt ``θ = atan(τ / f)`` in radians.

    >>> torch.rad2deg(tilt_from_tau(torch.tensor(0.5), torch.tensor(0.5)))
    tensor(45.)
    """
    return torch.atan(tau / focal)


def rho_from_tilt(
    tilt: Float[Tensor, "*#batch"],
    focal: Float[Tensor, "*#batch"],
    k1: Float[Tensor, "*#batch"],
    k2: Float[Tensor, "*#batch"],
) -> Float[Tensor, "*#batch"]:
    r"""Distorted offset :math:`\rho = f t (1 + k_1 t^2 + k_2 t^4)`, :math:`t = \tan\theta`, in image heights.

    Only where ``|t|`` is below the fold radius is the horizon's foot visible at ρ, and the tilt recoverable from it.

    >>> rho_from_tilt(torch.deg2rad(torch.tensor(45.0)), torch.tensor(1.2), torch.tensor(-0.2), torch.tensor(0.0))
    tensor(0.9600)
    """
    return focal * distort_radius(torch.tan(tilt), k1, k2)


def tilt_from_rho(
    rho: Float[Tensor, "*#batch"],
    focal: Float[Tensor, "*#batch"],
    k1: Float[Tensor, "*#batch"],
    k2: Float[Tensor, "*#batch"],
) -> Float[Tensor, "*#batch"]:
    """Tilt in radians: ``θ = atan(t)``, with t the undistorted radius of ``ρ / f``; the fold's if ρ is out of reach.

    >>> torch.rad2deg(tilt_from_rho(torch.tensor(0.96), torch.tensor(1.2), torch.tensor(-0.2), torch.tensor(0.0)))
    tensor(45.)
    """
    return torch.atan(undistort_radius(rho / focal, k1, k2))


def horizon_foot(rho: Float[Tensor, "*#batch"], roll: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch 2"]:
    """The horizon's point nearest to the centre, ``ρ (sin ψ, cos ψ)``: (u, v) in image heights from the centre.

    >>> horizon_foot(torch.tensor(0.25), torch.tensor(0.0))
    tensor([0.0000, 0.2500])
    """
    rho, roll = torch.broadcast_tensors(rho, roll)
    return rho[..., None] * torch.stack([torch.sin(roll), torch.cos(roll)], dim=-1)


def horizon_line(tau: Float[Tensor, "*#batch"], roll: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch 3"]:
    """The undistorted horizon as ``(a, b, c) = (sin ψ, cos ψ, -τ)``: ``a u + b v + c = 0`` in image heights.

    ``a u + b v + c`` is the signed distance of a point to it, positive on the side of the ground.

    >>> horizon_line(torch.tensor(0.25), torch.tensor(0.0))
    tensor([ 0.0000,  1.0000, -0.2500])
    """
    tau, roll = torch.broadcast_tensors(tau, roll)
    return torch.stack([torch.sin(roll), torch.cos(roll), -tau], dim=-1)


def horizon_points(
    camera: Camera, tilt: Float[Tensor, "*#batch"], roll: Float[Tensor, "*#batch"], azimuths: Float[Tensor, "n"]
) -> tuple[Float[Tensor, "*#batch n 2"], Bool[Tensor, "*#batch n"]]:
    """Pixels of the horizon, a curve under distortion, at azimuths from the viewing direction.

    ``azimuths`` are radians, positive to the right; the second result is false for points not in view. Tilt and roll
    have the shape of the camera's batch, or any shape for a single camera.

    >>> from sextant.geometry import PerspectiveCamera
    >>> camera = PerspectiveCamera.from_focal(1.0, 640, 480)
    >>> horizon_points(camera, torch.tensor(0.0), torch.tensor(0.0), torch.tensor([0.0, 3.14]))
    (tensor([[320.0000, 240.0000],
            [320.7644, 240.0000]]), tensor([ True, False]))
    """
    level = torch.stack([torch.sin(azimuths), torch.zeros_like(azimuths), torch.cos(azimuths)], dim=-1)  # (n, 3)
    return camera.project(level @ rotation_from_tilt_roll(tilt, roll))  # d @ R = R^T d: camera from gravity
