"""Faults of robot, sensors and map in localization."""

from typing import Annotated, Literal

from pydantic import Field

from sextant.config.schema.parts import Choice, Count, Node, NonNegative, Part, Positive

Frame = Annotated[float, Field(gt=0)]
#: a share, including 0 and 1
Portion = Annotated[float, Field(ge=0, le=1)]


class Fault(Part):
    """A fault."""


class NoFault(Fault):
    """No fault."""

    target: Literal["sextant.data.localization.faults.NoFault"] = Field(alias="_target_")


class Kidnap(Fault):
    """The kidnapped robot: it is carried elsewhere."""

    target: Literal["sextant.data.localization.faults.Kidnap"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    distance: NonNegative = Field(examples=[10.0])
    after: Count | None = Field(examples=[100])


class WrongStart(Fault):
    """The filter starts around a wrong pose."""

    target: Literal["sextant.data.localization.faults.WrongStart"] = Field(alias="_target_")
    distance: NonNegative = Field(examples=[5.0])
    heading_deg: Annotated[float, Field(ge=0, le=180)] = Field(examples=[90.0])


class DroppedFrames(Fault):
    """Images are lost at random."""

    target: Literal["sextant.data.localization.faults.DroppedFrames"] = Field(alias="_target_")
    share: Portion = Field(examples=[0.5])


class Blackout(Fault):
    """No image arrives for a while."""

    target: Literal["sextant.data.localization.faults.Blackout"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[30])


class OdometryScale(Fault):
    """Wrong odometry scale, as from wheels of another size."""

    target: Literal["sextant.data.localization.faults.OdometryScale"] = Field(alias="_target_")
    factor: Positive = Field(examples=[1.1])
    turn: Positive = Field(examples=[1.0])


class OdometrySlip(Fault):
    """Slipping wheels."""

    target: Literal["sextant.data.localization.faults.OdometrySlip"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[20])
    kind: Literal["spinning", "sliding"]


class MissingOdometry(Fault):
    """Odometry is missing for a while."""

    target: Literal["sextant.data.localization.faults.MissingOdometry"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[10])


class NoisyMapPoses(Fault):
    """Noise in the poses of the map images."""

    target: Literal["sextant.data.localization.faults.NoisyMapPoses"] = Field(alias="_target_")
    position: NonNegative = Field(examples=[0.5])
    heading_deg: NonNegative = Field(examples=[5.0])


class ThinnedMap(Fault):
    """A map with fewer images."""

    target: Literal["sextant.data.localization.faults.ThinnedMap"] = Field(alias="_target_")
    keep: Annotated[float, Field(gt=0, le=1)] = Field(examples=[0.25])


class WrongSeasonMap(Fault):
    """A map made under another condition."""

    target: Literal["sextant.data.localization.faults.WrongSeasonMap"] = Field(alias="_target_")
    condition: str = Field(examples=["winter_noon"])


class FaultSuite(Node):
    """Several faults, each tested in runs of its own."""

    faults: Annotated[dict[str, Choice[Fault]], Field(min_length=1)]
