r"""The four numbers that a network predicts for a camera, which give its tilt, roll, focal length and distortion.

======================= ========== ====== ======== ===========
parameterization         1st        2nd    3rd      4th
======================= ========== ====== ======== ===========
``direct``               tilt θ     roll   focal f  k1
``angles``               tilt θ     roll   vfov     k1
``horizon``              offset ρ   roll   vfov     k1 / f²
``undistorted_horizon``  offset τ   roll   vfov     k1 / f²
======================= ========== ====== ======== ===========

ρ and τ are the offsets of the horizon from the image centre with and without distortion
(:mod:`sextant.geometry.horizon`), vfov the nominal vertical field of view 2 atan(1 / 2f), and
:math:`\hat k_1 = k_1 / f^2` the *apparent* distortion: with :math:`R = f r` in image heights the lens displaces by
:math:`1 + \hat k_1 R^2 + \ldots`, so that this coefficient, unlike k1, is observable in the picture. Angles are in
radians, lengths in image heights.

Source: M. Lopez-Antequera et al., "Deep single image camera calibration with radial distortion", CVPR 2019, section 3.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.geometry.distortion import K2Family, k2_of_k1
from sextant.geometry.horizon import rho_from_tilt, tau_from_tilt, tilt_from_rho, tilt_from_tau
from sextant.ranges import checked
from sextant.shapes import check_shape

Name = Literal["direct", "angles", "horizon", "undistorted_horizon"]
#: upper limits of the focal length and field of view; the lower limits are 0
SIZE_LIMITS = {"focal": math.inf, "vfov": math.pi}


class CameraParameters(NamedTuple):
    """The calibrated parameters, as tensors of one shape.

    >>> camera = CameraParameters(*torch.tensor([0.1, 0.0, 1.2, -0.2]))
    >>> camera.focal
    tensor(1.2000)

    Attributes:
        tilt: radians, positive upwards.
        roll: radians.
        focal: image heights.
        k1: first coefficient of radial distortion; the second follows from the lens family.
    """

    tilt: Float[Tensor, "*b"]
    roll: Float[Tensor, "*b"]
    focal: Float[Tensor, "*b"]
    k1: Float[Tensor, "*b"]

    def to(self, *, dtype: torch.dtype | None = None, device: torch.device | None = None) -> "CameraParameters":
        """The same values of another type or on another device."""
        return CameraParameters(*(value.to(dtype=dtype, device=device) for value in self))

    def at(self, index: int | slice | Tensor) -> "CameraParameters":
        """Some of the cameras."""
        return CameraParameters(*(value[index] for value in self))


def vfov_from_focal(focal: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Nominal vertical field of view ``2 atan(1 / (2 f))``, radians.

    >>> torch.rad2deg(vfov_from_focal(torch.tensor(0.5)))
    tensor(90.)
    """
    return 2 * torch.atan(0.5 / focal)


def focal_from_vfov(vfov: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Focal length ``1 / (2 tan(vfov / 2))`` in image heights.

    >>> focal_from_vfov(torch.deg2rad(torch.tensor(90.0)))
    tensor(0.5000)
    """
    return 0.5 / torch.tan(vfov / 2)


@checked
@dataclass(frozen=True)
class Parameterization:
    """A map between cameras and the four numbers that a network predicts; see the module's table.

    One to one for tilts in (-π/2, π/2) and positive focal lengths; with ``horizon``, ``|tan θ|`` must also be below the
    fold radius of the lens, beyond which the foot of the horizon is not visible (with ``lopez``, it is at least 3.26).

    Args:
        name: ``direct``, ``angles``, ``horizon`` or ``undistorted_horizon``.
        k2_of_k1: the lens family, ``lopez`` or ``zero``: a network predicts k1 alone, so k2 must follow from it.

    Raises:
        UserError: the name is unknown, or the family does not determine k2 from k1.

    Example:
        >>> camera = CameraParameters(*torch.tensor([[0.0], [0.0], [0.5], [-0.1]]))  # tilt, roll, focal, k1
        >>> Parameterization("angles").encode(camera)  # a focal length of half the height sees a right angle: π / 2
        tensor([[ 0.0000,  0.0000,  1.5708, -0.1000]])
    """

    name: Name = "horizon"
    k2_of_k1: K2Family = "lopez"

    def __post_init__(self) -> None:
        if self.k2_of_k1 not in ("lopez", "zero"):
            raise ArgumentError(
                f"k2_of_k1={self.k2_of_k1!r}: a network predicts k1 alone, so k2 must follow from it",
                "Choose lopez or zero.",
            )

    @property
    def names(self) -> tuple[str, str, str, str]:
        """Names of the four numbers."""
        if self.name == "direct":
            return "tilt", "roll", "focal", "k1"
        if self.name == "angles":
            return "tilt", "roll", "vfov", "k1"
        return "rho" if self.name == "horizon" else "tau", "roll", "vfov", "k1_hat"

    def k2(self, k1: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
        """The second coefficient that belongs to ``k1`` in this lens family."""
        return k2_of_k1(k1, self.k2_of_k1)

    def encode(self, camera: CameraParameters) -> Float[Tensor, "*b 4"]:
        """The four numbers of a camera."""
        tilt, roll, focal, k1 = camera
        if self.name == "direct":
            return torch.stack([tilt, roll, focal, k1], -1)
        if self.name == "angles":
            return torch.stack([tilt, roll, vfov_from_focal(focal), k1], -1)
        offset = rho_from_tilt(tilt, focal, k1, self.k2(k1)) if self.name == "horizon" else tau_from_tilt(tilt, focal)
        return torch.stack([offset, roll, vfov_from_focal(focal), k1 / focal.square()], -1)

    def decode(self, values: Float[Tensor, "*b 4"]) -> CameraParameters:
        """The camera of four numbers: field of view, then k1 and k2, then tilt. Differentiable.

        Any numbers decode, with finite gradients, as long as the focal length is positive or the field of view inside
        (0, π); an offset that the lens does not reach gives the tilt of the fold.
        """
        offset, roll, size, bend = values.unbind(-1)
        if self.name == "direct":
            return CameraParameters(offset, roll, size, bend)
        focal = focal_from_vfov(size)
        if self.name == "angles":
            return CameraParameters(offset, roll, focal, bend)
        k1 = bend * focal.square()
        tilt = tilt_from_rho(offset, focal, k1, self.k2(k1)) if self.name == "horizon" else tilt_from_tau(offset, focal)
        return CameraParameters(tilt, roll, focal, k1)


@dataclass(frozen=True, eq=False)
class ParameterSpace:
    """A parameterization with the range of each number: the possible outputs of a bounded network.

    Args:
        parameterization: the four numbers.
        low: lower ends, ``(4,)``.
        high: upper ends, ``(4,)``.

    Raises:
        UserError: the ends are not 4 numbers each, or a range is empty or not finite, or contains an impossible focal
            length or field of view.

    Example:
        >>> low, high = torch.tensor([-1.0, -1.0, 1.0, -1.0]), torch.tensor([1.0, 1.0, 3.0, 1.0])
        >>> space = ParameterSpace(Parameterization("direct"), low, high)
        >>> space.from_unit(torch.full((1, 4), 0.5)), space.to_unit(low)  # the middle of the ranges; their lower ends
        (tensor([[0., 0., 2., 0.]]), tensor([0., 0., 0., 0.]))
    """

    parameterization: Parameterization
    low: Float[Tensor, "4"]
    high: Float[Tensor, "4"]

    def __post_init__(self) -> None:
        for name, ends in (("low", self.low), ("high", self.high)):
            check_shape(name, ends, 4, fix=f"Give the ends of {', '.join(self.parameterization.names)}.")
        for name, low, high in zip(self.parameterization.names, self.low.tolist(), self.high.tolist(), strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise UserError(
                    f"the range of {name} is empty or not finite: from {low:.6g} to {high:.6g}",
                    "The lower end must be below the upper end.",
                )
            limit = SIZE_LIMITS.get(name)
            if limit is not None and not (low > 0 and high < limit):
                raise UserError(
                    f"the range of {name}, from {low:.6g} to {high:.6g}, exceeds 0 to {limit:.6g}",
                    "A focal length is positive, and a nominal field of view lies between 0 and pi radians.",
                )

    @classmethod
    def covering(
        cls, parameterization: Parameterization, cameras: CameraParameters, margin: float = 0.02
    ) -> "ParameterSpace":
        """The smallest space that holds ``cameras``, widened by ``margin`` of its extent on each side.

        The ends of a focal length or field of view move at most half-way to the impossible values 0 and π.
        """
        values = parameterization.encode(cameras)
        low, high = values.amin(0), values.amax(0)
        room = margin * (high - low).clamp(min=1e-3)
        limit = SIZE_LIMITS[parameterization.names[2]]
        size = torch.tensor([False, False, True, False], device=low.device)
        return cls(
            parameterization,
            torch.where(size, torch.maximum(low - room, low / 2), low - room),
            torch.where(size, torch.minimum(high + room, high / 2 + limit / 2), high + room),
        )

    def to(self, device: torch.device) -> "ParameterSpace":
        """The same space on another device."""
        return ParameterSpace(self.parameterization, self.low.to(device), self.high.to(device))

    def from_unit(self, unit: Float[Tensor, "*b 4"]) -> Float[Tensor, "*b 4"]:
        """Values at ``unit`` in [0, 1] along each range."""
        low, high = self.low.to(unit), self.high.to(unit)
        return low + (high - low) * unit

    def to_unit(self, values: Float[Tensor, "*b 4"]) -> Float[Tensor, "*b 4"]:
        """Positions of values along each range; 0 to 1 inside it."""
        low, high = self.low.to(values), self.high.to(values)
        return (values - low) / (high - low)
