"""The config of COSFIRE: banks, strategies, filters and features."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from sextant.chapters.places.config import DescribingConfig, ToleranceByUnit
from sextant.config.schema.images import Augmentation
from sextant.config.schema.parts import Choice, Node, Part, distinct
from sextant.config.schema.run import TaskNode
from sextant.ranges import Count, NonNegative, Positive, Seed, Share

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
    wavelengths: Annotated[list[Annotated[float, Field(gt=2, le=1000)]], Field(min_length=1, examples=["[2.83,4]"])]
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


RecognitionMethod = Literal[
    "cosfire_svm",
    "tiled_svm",
    "strongest_filter",
    "full_svm",
    "pooled_svm",
    "nearest",
    "nearest_short",
    "network",
    "descriptor",
]


def once(values: list[str]) -> list[str]:
    """Return ``values`` if they are all different.

    Raises:
        ValueError: two values are equal.
    """
    if len(set(values)) < len(values):
        raise ValueError(f"values must differ, got {values}")
    return values


class SceneChoice(Node):
    """Places as classes."""

    references: list[str] = Field(min_length=1, examples=["[summer_noon]"])
    queries: list[str] = Field(min_length=1, examples=["[autumn_rain,night_clear]"])
    spacing: Count = Field(examples=[5])
    neighbours: Annotated[int, Field(ge=0, le=1000)] = Field(examples=[0])
    tolerance: ToleranceByUnit


class FineTune(Node):
    """Fine-tuning of configured filters."""

    epochs: Annotated[int, Field(ge=0, le=100_000)] = Field(examples=[0])
    lr: Positive = Field(examples=[0.001])


class CosfireTask(TaskNode):
    """Recognition by filters configured from examples."""

    name: Literal["cosfire"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    images: Count | None = Field(examples=[10000])
    novel_classes: Annotated[int, Field(ge=0, le=100_000)] = Field(examples=[5])
    examples: Count | None = Field(examples=[20])
    filters_per_class: Count = Field(examples=[10])
    at: Literal["random", "centre"]
    margin: Annotated[float, Field(ge=0, lt=0.5)] = Field(examples=[0.15])
    least_parts: Count = Field(examples=[2])
    methods: Annotated[list[RecognitionMethod], Field(min_length=1), AfterValidator(once)] = Field(
        examples=["[cosfire_svm,full_svm]"]
    )
    prices: Annotated[list[Positive], Field(min_length=1), AfterValidator(distinct)] = Field(examples=["[0.01,0.1,1]"])
    scalings: Annotated[
        list[Literal["all", "each", "unit"]], Field(min_length=1, examples=["[all]"]), AfterValidator(once)
    ]
    choose_among: Count = Field(examples=[1500])
    logarithms: bool
    tiles: Annotated[int, Field(ge=1, le=16)] = Field(examples=[2])
    fine_tune: FineTune
    scenes: SceneChoice | None
    test_every: Count = Field(examples=[1])
    test_checkpoint: Literal["last"]

    def answering(self) -> list[str]:
        """The methods whose answers a run has, if it has the parts for them."""
        return [*self.methods, "cosfire_tuned", "layer_tuned"] if self.fine_tune.epochs else list(self.methods)


class CosfireConfig(DescribingConfig):
    """The config of a run of recognition by filters."""

    task: CosfireTask
    features: Features
    bank: Choice[Bank]
    strategy: Choice[Strategy]
    filters: Filters
    augmentation: Choice[Augmentation] | None = None


CONFIG = CosfireConfig
