"""The interface of motion models: where a robot may be after the motion that odometry reports."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.geometry.planar import se2_compose, se2_exp


class MotionModel(ABC):
    r"""Draws :math:`x_t \sim p(x_t \mid x_{t-1}, u_t)` for every particle.

    A motion with a value that is not finite is unknown: odometry is missing. The particles of such a run diffuse around
    where they were, :math:`x_t = x_{t-1} \circ \exp(\epsilon)`, where :math:`\epsilon` has the standard deviations
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
            generator: generator of random numbers, from which as many are drawn whether or not a motion is known.
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


def check_not_negative(argument: str, values: Sequence[float], count: int) -> None:
    """Refuse anything but ``count`` finite numbers of at least 0.

    Raises:
        ArgumentError: names the argument and the values.
    """
    if len(values) != count or not all(0 <= value < float("inf") for value in values):
        raise ArgumentError(
            f"{argument}={list(values)} must be {count} finite numbers of at least 0",
            f"For example {argument}=[{','.join(['0.1'] * count)}]",
        )
