"""What is predicted of a camera, how wrong it is, and where cameras are drawn from."""

from typing import Literal

from pydantic import ConfigDict, Field

from sextant.config.schema.parts import Node, Part, Positive


class Parameterization(Part):
    """What a network predicts of a camera."""

    target: Literal["sextant.geometry.Parameterization"] = Field(alias="_target_")
    name: Literal["direct", "angles", "horizon", "undistorted_horizon"]
    k2_of_k1: Literal["lopez", "zero"]


class Sampling(Part):
    """A distribution of cameras."""

    model_config = ConfigDict(extra="allow")

    target: Literal["sextant.data.calibration.CameraDistribution"] | str = Field(alias="_target_")
    k2_of_k1: Literal["lopez", "zero"]


class CameraLoss(Part):
    """A loss of predicted cameras."""


class ParameterLoss(CameraLoss):
    """Errors of the parameters."""

    target: Literal["sextant.losses.ParameterLoss"] = Field(alias="_target_")
    units: Literal["raw", "range", "natural"]
    penalty: Literal["l2", "huber"]
    delta: Positive = Field(examples=[0.1])


class BearingLoss(CameraLoss):
    """Errors of the rays."""

    target: Literal["sextant.losses.BearingLoss"] = Field(alias="_target_")
    mode: Literal["joint", "disentangled", "harmonic"]
    grid: int = Field(ge=2, le=64, examples=[7])


class PoseLensLoss(CameraLoss):
    """Errors of the direction of gravity and of the lens."""

    target: Literal["sextant.losses.PoseLensLoss"] = Field(alias="_target_")
    focal_weight: Positive = Field(examples=[0.5])
    bend_weight: Positive = Field(examples=[0.5])


class Canvas(Node):
    """Pictures in squares, low-passed."""

    lines: Positive = Field(examples=[96])
    detail: list[Positive] = Field(min_length=2, max_length=2, examples=["[40,224]"])
