"""Camera parameterizations, losses, and distributions of cameras."""

from typing import Literal

from pydantic import ConfigDict, Field

from sextant.config.schema.parts import Node, Part, Positive


class Parameterization(Part):
    """The quantities of a camera that a network predicts."""

    target: Literal["sextant.geometry.Parameterization"] = Field(alias="_target_")
    name: Literal["direct", "angles", "horizon", "undistorted_horizon"]
    k2_of_k1: Literal["lopez", "zero"]


class Sampling(Part):
    """A distribution of cameras."""

    model_config = ConfigDict(extra="allow")

    target: Literal["sextant.data.calibration.CameraDistribution"] | str = Field(alias="_target_")
    k2_of_k1: Literal["lopez", "zero"]


class CameraLoss(Part):
    """A loss on predicted cameras."""


class ParameterLoss(CameraLoss):
    """Loss on errors of the camera parameters."""

    target: Literal["sextant.losses.ParameterLoss"] = Field(alias="_target_")
    units: Literal["raw", "range", "natural", "learned"]
    penalty: Literal["l2", "huber"]
    delta: Positive = Field(examples=[0.1])


class BearingLoss(CameraLoss):
    """Loss on errors of the rays."""

    target: Literal["sextant.losses.BearingLoss"] = Field(alias="_target_")
    mode: Literal["joint", "disentangled", "harmonic"]
    grid: int = Field(ge=2, le=64, examples=[7])


class PoseLensLoss(CameraLoss):
    """Loss on errors of the direction of gravity and of the lens."""

    target: Literal["sextant.losses.PoseLensLoss"] = Field(alias="_target_")
    focal_weight: Positive = Field(examples=[0.5])
    bend_weight: Positive = Field(examples=[0.5])


class Canvas(Node):
    """Low-passed photos on a square canvas."""

    lines: Positive = Field(examples=[96])
    detail: list[Positive] = Field(min_length=2, max_length=2, examples=["[40,224]"])


class FieldPrediction(Node):
    """How a network learns the perspective field of a picture."""

    weight: Positive = Field(examples=[0.1])
