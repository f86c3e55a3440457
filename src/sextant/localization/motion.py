"""Motion models: the distribution of a robot's pose after the motion that odometry reports."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import se2_compose, se2_exp, wrap_angle
from sextant.localization.constants import ASIDE, FURTHER, ODOMETRY, ONE_IN, UNKNOWN
from sextant.ranges import NonNegative, checked

__all__ = ["ExponentialMotion", "IdentityMotion", "MotionModel", "OdometryMotion"]


class MotionModel(ABC):
    r"""Draws :math:`x_t \sim p(x_t \mid x_{t-1}, u_t)` for every particle.

    A motion with a value that is not finite is unknown: odometry is missing. The particles of such a run diffuse around
    their previous poses, :math:`x_t = x_{t-1} \circ \exp(\epsilon)`, where :math:`\epsilon` has the standard deviations
    :meth:`if_unknown` in the robot's frame.
    """

    def sample(
        self,
        poses: Float64[Tensor, "r p 3"],
        motion: Float64[Tensor, "r 3"],
        generator: torch.Generator,
    ) -> Float64[Tensor, "r p 3"]:
        """Poses after each run's motion, one draw for each particle.

        Args:
            poses: poses before the motion.
            motion: ``b_from_c``, the increment in the robot's frame; nan where odometry is missing.
            generator: generator of random numbers; as many are drawn for unknown motions as for known ones.
        """
        noise = torch.randn(poses.shape, generator=generator, dtype=poses.dtype, device=poses.device)
        known: Bool[Tensor, "r"] = motion.isfinite().all(1)
        if bool(known.all()):
            return se2_compose(poses, self.increments(motion, noise))
        told = self.increments(motion.masked_fill(~known[:, None], 0.0), noise)
        return se2_compose(poses, torch.where(known[:, None, None], told, self.unmeasured(noise)))

    def unmeasured(self, noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """The motion of each particle where motion is unknown, as a function of standard normal noise."""
        return se2_exp(noise * noise.new_tensor(self.if_unknown()))

    @abstractmethod
    def if_unknown(self) -> Sequence[float]:
        """Standard deviations along, across (metres) and in heading (rad) of an unknown motion."""

    @abstractmethod
    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "#r #p 3"]:
        """The motion of each particle, as a function of standard normal noise."""


@dataclass(frozen=True)
class IdentityMotion(MotionModel):
    """:math:`x_t = x_{t-1}`, whatever odometry reports. There is no noise, so particles never spread.

    Example:
        >>> poses, metre = torch.ones(1, 1, 3).double(), torch.tensor([[1.0, 0.0, 0.0]]).double()
        >>> IdentityMotion().sample(poses, metre, torch.Generator())
        tensor([[[1., 1., 1.]]], dtype=torch.float64)
    """

    def if_unknown(self) -> Sequence[float]:
        """No motion."""
        return (0.0, 0.0, 0.0)

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r 1 3"]:
        """No motion."""
        return torch.zeros_like(motion)[:, None]


#: The golden ratio: its multiples modulo 1 are spread evenly, so that numbers of particles choose a share of them.
GOLDEN = (math.sqrt(5) - 1) / 2
#: The noise of an unknown motion, in multiples of the noise of a step.
STEPS_IF_UNKNOWN = 20.0


@checked
@dataclass(frozen=True)
class ExponentialMotion(MotionModel):
    r""":math:`x_t = x_{t-1} \circ u_t \circ \exp(\epsilon)`, :math:`\epsilon \sim \mathcal N(0, \mathrm{diag}(v))`, and

    .. math:: v = \sigma_{step}^2 + |t|\, v_{metre} + |\theta|\, v_{radian}

    for a motion :math:`u = (t, \theta)`. The noise grows like a random walk with the distance and with the turn.

    Args:
        per_step: standard deviations along, across (metres) and in heading (rad), however small the motion.
        per_metre: variances for each metre travelled.
        per_radian: variances for each radian turned.
        unknown: standard deviations where odometry is missing; None for twenty times ``per_step``. A coordinate without
            noise then has none without odometry either: a train stays on its line.

    Raises:
        UserError: an argument is not three finite numbers of at least 0.

    Example:
        >>> import torch
        >>> model = ExponentialMotion(per_step=(0.0, 0.0, 0.0), per_metre=(0.04, 0.0, 0.0))
        >>> poses, metre = torch.zeros(1, 1000, 3).double(), torch.tensor([[1.0, 0.0, 0.0]]).double()
        >>> moved = model.sample(poses, metre, torch.Generator().manual_seed(0))
        >>> round(moved[0, :, 0].std().item(), 2)  # along, after one metre: sqrt(0.04)
        0.2
    """

    per_step: tuple[NonNegative, NonNegative, NonNegative] = (0.025, 0.01, 0.015)
    per_metre: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)
    per_radian: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)
    unknown: tuple[NonNegative, NonNegative, NonNegative] | None = None

    def if_unknown(self) -> Sequence[float]:
        """``unknown``, or twenty times ``per_step``."""
        return [STEPS_IF_UNKNOWN * sigma for sigma in self.per_step] if self.unknown is None else self.unknown

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """:math:`u \\circ \\exp(\\epsilon)`."""
        return se2_compose(motion[:, None], se2_exp(noise * self.sigmas(motion)[:, None]))

    def sigmas(self, motion: Float64[Tensor, "r 3"]) -> Float64[Tensor, "r 3"]:
        """Standard deviations :math:`\\sqrt v` of the noise of each motion."""
        way, turn = motion[:, :2].norm(dim=1), motion[:, 2].abs()
        variance = (
            motion.new_tensor(self.per_step).square()
            + way[:, None] * motion.new_tensor(self.per_metre)
            + turn[:, None] * motion.new_tensor(self.per_radian)
        )
        found: Tensor = variance.sqrt()
        return found


@checked
@dataclass(frozen=True)
class OdometryMotion(MotionModel):
    r"""The odometry model with four alphas; noiseless when they are 0.

    .. math:: \hat\delta_{1} &= \delta_{1} + \mathcal N(0, \alpha_1 \delta_1^2 + \alpha_2 d^2) \\
       \hat d &= d + \mathcal N(0, \alpha_3 d^2 + \alpha_4 (\delta_1^2 + \delta_2^2)) \\
       \hat\delta_{2} &= \delta_{2} + \mathcal N(0, \alpha_1 \delta_2^2 + \alpha_2 d^2)

    Source: Thrun, Burgard & Fox, "Probabilistic Robotics", MIT Press 2005, table 5.6, with the robot's frame as the
    origin. The table leaves two cases open. A robot that drives backwards does not turn round first: the first rotation
    is folded into [-π/2, π/2], and d is then negative. Where the robot hardly moves, the direction is noise: in the
    variances the first rotation then counts as zero, and the second as the whole turn.

    Args:
        alphas: variance of rotation by rotation, of rotation by translation (rad²/m²), of translation by translation,
            of translation by rotation (m²/rad²).
        least_translation: distance in metres below which the direction of a motion is treated as noise.
        unknown: standard deviations along, across and in heading where odometry is missing.

    Raises:
        UserError: a value is negative or not finite, or an argument has the wrong number of values.

    Example:
        >>> exact, motion = OdometryMotion(alphas=(0.0, 0.0, 0.0, 0.0)), torch.tensor([[-1.0, 0.0, 0.0]]).double()
        >>> exact.sample(torch.zeros(1, 1, 3).double(), motion, torch.Generator())  # a metre backwards
        tensor([[[-1.,  0.,  0.]]], dtype=torch.float64)
    """

    alphas: tuple[NonNegative, NonNegative, NonNegative, NonNegative] = (0.2, 0.2, 0.2, 0.2)
    least_translation: NonNegative = 0.01
    unknown: tuple[NonNegative, NonNegative, NonNegative] = (0.5, 0.2, 0.2)

    def if_unknown(self) -> Sequence[float]:
        """``unknown``."""
        return self.unknown

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """The motion with noise on each of its three parts."""
        first, way, second = _parts(motion)
        small = way.abs() < self.least_translation
        turned = torch.where(small, 0.0, first)
        turned_after = torch.where(small, motion[:, 2], second)
        a1, a2, a3, a4 = self.alphas
        variances = torch.stack(
            [
                a1 * turned**2 + a2 * way**2,
                a3 * way**2 + a4 * (turned**2 + turned_after**2),
                a1 * turned_after**2 + a2 * way**2,
            ],
            dim=1,
        )
        parts = torch.stack([first, way, second], dim=1)[:, None] + noise * variances.sqrt()[:, None]
        first, way, second = parts.unbind(2)
        return torch.stack([way * first.cos(), way * first.sin(), wrap_angle(first + second)], dim=2)


def _parts(motion: Float64[Tensor, "r 3"]) -> tuple[Tensor, Tensor, Tensor]:
    direction = torch.atan2(motion[:, 1], motion[:, 0])
    back = direction.abs() > math.pi / 2
    first = torch.where(back, wrap_angle(direction + math.pi), direction)
    way = motion[:, :2].norm(dim=1)
    return first, torch.where(back, -way, way), wrap_angle(motion[:, 2] - first)


@dataclass(frozen=True)
class PacedMotion(MotionModel):
    r"""Moves as ``measured`` where motion is known; where it is unknown, four in five particles keep the pace.

    .. math:: x_t = x_{t-1} \circ \exp\big((v, 0, 0) + D\,\epsilon\big),

    where v is the pace and ε has the standard deviations ``measured.if_unknown()``. Robots mostly continue as before:
    D = diag(q, 1, 1), with the departure q from the pace. One particle in five has D = diag(q, 1, 4), for a robot that
    turns a corner. One in five has v = 0 and D = diag(4, 1, 1), for a robot that turns back or drives much faster.
    Without a pace v = 0, q = 1, and half of the particles behave like the latter. A particle keeps its role until it is
    resampled. A model without noise along the heading gets no pace either. A robot stands with some probability; that
    share of the particles does not move.

    Args:
        measured: model of known motions, and of the standard deviations of unknown ones.
        pace: distance along the heading from one step to the next of each run, in the unit of the map
            (:class:`~sextant.localization.constant_velocity.ConstantVelocity`); nan if it is not known.
        departure: q of each run, in (0, 1]; not used without a pace.
        still: probability that each run's robot stands.

    Example:
        >>> from sextant.localization.motion import ExponentialMotion
        >>> measured, pace = ExponentialMotion((0.1, 0.0, 0.0), unknown=(1e-9, 0.0, 0.0)), torch.tensor([2.0]).double()
        >>> model = PacedMotion(measured, pace, torch.tensor([0.5]).double(), still=torch.zeros(1).double())
        >>> unknown = torch.full((1, 3), torch.nan).double()
        >>> model.sample(torch.zeros(1, 5, 3).double(), unknown, torch.Generator())[0, :, 0].round().abs().tolist()
        [2.0, 2.0, 2.0, 2.0, 0.0]
    """

    measured: MotionModel
    pace: Float64[Tensor, " r"]
    departure: Float64[Tensor, " r"]
    still: Float64[Tensor, " r"]

    def if_unknown(self) -> Sequence[float]:
        """The standard deviations of ``measured``."""
        return self.measured.if_unknown()

    def increments(self, motion: Float64[Tensor, "r 3"], noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "#r #p 3"]:
        """The increments of ``measured``."""
        return self.measured.increments(motion, noise)

    def unmeasured(self, noise: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p 3"]:
        """Every fifth particle (without a pace every second) spreads further along, another in heading; some stand."""
        deviations = noise.new_tensor(self.if_unknown())
        twist = noise * deviations
        paced, number = self.pace.isfinite()[:, None, None], torch.arange(noise.shape[1], device=noise.device)[:, None]
        kept = self.pace[:, None, None].where(paced & (deviations[0] > 0), 0.0) * deviations.new_tensor([1.0, 0.0, 0.0])
        one_in = torch.where(paced, ONE_IN, 2)
        further, turning = number % one_in == one_in - 1, number % ONE_IN == 2
        turned = torch.where(turning, twist * twist.new_tensor([1.0, 1.0, FURTHER]), twist)
        turned[..., 0] = torch.where(paced, self.departure[:, None, None], 1.0)[..., 0] * turned[..., 0]
        moved = torch.where(further, twist * twist.new_tensor([FURTHER, 1.0, 1.0]), turned + kept)
        stands = number.double() * GOLDEN % 1 < self.still[:, None, None]
        return se2_exp(moved.masked_fill(stands, 0.0))


def motion_of_spacing(spacing: float, line: bool = False) -> ExponentialMotion:
    """Odometry that errs by three tenths over one spacing of a map, and by two spacings where it is missing.

    Wheels err by a tenth or less, but in the same way in each step. Errors beyond the noise have to be corrected by
    images step by step, and the filter falls behind unnoticed (results/localization_change.md, "When odometry is
    wrong").

    Args:
        spacing: spacing of the map's images, in the unit of positions, above 0
            (:func:`~sextant.localization.map_support.map_spacing`).
        line: whether positions lie along a line, with no errors across it.

    >>> motion_of_spacing(2.0).unknown
    (4.0, 0.4, 0.1)
    >>> motion_of_spacing(2.0, line=True).unknown
    (4.0, 0.0, 0.0)
    """
    aside = 0.0 if line else ASIDE
    along, across = ODOMETRY**2, (ODOMETRY * aside) ** 2
    return ExponentialMotion(
        per_step=(0.0, 0.0, 0.0),
        per_metre=(along * spacing, across * spacing, across / max(1.0, spacing)),
        per_radian=(0.0, across * spacing**2, across),
        unknown=(UNKNOWN * spacing, aside * UNKNOWN * spacing, aside),
    )
