"""The config of COSFIRE: banks, strategies, filters and features."""

from typing import Annotated, Literal

from pydantic import Field

from sextant.config.schema.parts import Count, Node, NonNegative, Part, Positive

UnitShare = Annotated[float, Field(ge=0, le=1)]
Border = Literal["zeros", "replicate", "reflect", "circular"]


class Features(Node):
    """The feature map that filters and SVMs use."""

    later = ("frozen",)
    run: str | None = Field(examples=["3f9a1c2e-s0"])
    layer: str | None = Field(examples=["conv2"])
    frozen: bool | None = None


class Bank(Part):
    """The bank of responses from which filters are composed."""


class GaborBank(Bank):
    """Gabor filters."""

    target: Literal["sextant.layers.cosfire.GaborBank"] = Field(alias="_target_")
    wavelengths: Annotated[list[Annotated[float, Field(ge=2, le=1000)]], Field(min_length=1, examples=["[2.83,4]"])]
    orientations: Count = Field(examples=[16])
    span_deg: Positive | None = Field(examples=[360.0])
    phase_deg: float = Field(examples=[90.0])
    bandwidth: Positive = Field(examples=[2.0])
    aspect: Positive = Field(examples=[0.5])
    border: Border


class DoGBank(Bank):
    """Differences of Gaussians."""

    target: Literal["sextant.layers.cosfire.DoGBank"] = Field(alias="_target_")
    sigmas: Annotated[list[Positive], Field(min_length=1, examples=["[1.0,2.4]"])]
    polarities: Annotated[list[Literal[-1, 1]], Field(min_length=1, examples=["[1,-1]"])]
    ratio: Positive = Field(examples=[0.5])
    border: Border


class FeatureBank(Bank):
    """Channels of the feature map."""

    target: Literal["sextant.layers.cosfire.FeatureBank"] = Field(alias="_target_")
    normalise: bool


class VectorBank(Bank):
    """Directions in the feature map."""

    target: Literal["sextant.layers.cosfire.VectorBank"] = Field(alias="_target_")
    least: UnitShare = Field(examples=[0.05])


class Strategy(Part):
    """How a filter is configured from an example."""


class ConcentricCircles(Strategy):
    """Strategy C: circles about the point."""

    target: Literal["sextant.layers.cosfire.ConcentricCircles"] = Field(alias="_target_")
    radii: Annotated[list[NonNegative], Field(min_length=1, examples=["[0,3,8]"])]
    t2: UnitShare = Field(examples=[0.75])
    relative_to: Literal["place", "example"]
    apart_deg: NonNegative = Field(examples=[22.5])
    one_of: bool


class _Keypoints(Strategy):
    window: Annotated[int, Field(ge=0, le=1000)] = Field(examples=[1])
    reach: Positive = Field(examples=[8.0])
    strength: UnitShare = Field(examples=[0.2])
    apart: NonNegative = Field(examples=[1.0])
    most: Count = Field(examples=[20])


class ChannelPeaks(_Keypoints):
    """Strategy A: peaks of channels."""

    target: Literal["sextant.layers.cosfire.ChannelPeaks"] = Field(alias="_target_")
    t2: UnitShare = Field(examples=[0.75])


class VectorKeypoints(_Keypoints):
    """Strategy B: vectors of keypoints."""

    target: Literal["sextant.layers.cosfire.VectorKeypoints"] = Field(alias="_target_")


class Filters(Node):
    """How filters respond."""

    sigma0: NonNegative = Field(examples=[0.67])
    alpha: NonNegative = Field(examples=[0.1])
    blur: Literal["max", "sum"]
    mean: Literal["geometric", "arithmetic", "harmonic", "trimmed", "median"]
    least_weight: Annotated[float, Field(gt=0, le=1)] = Field(examples=[0.5])
    rotations: Count = Field(examples=[1])
    span_deg: Positive = Field(examples=[360.0])
    scales: Annotated[list[Positive], Field(min_length=1, examples=["[1.0]"])]
    reflection: bool
    shift: Literal["whole", "bilinear"]
    border: Border
    t1: UnitShare = Field(examples=[0.05])
    t3: UnitShare = Field(examples=[0.0])
    floor: NonNegative = Field(examples=[0.01])
