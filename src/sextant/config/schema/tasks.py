"""The families of method."""

from typing import Annotated, Literal

from pydantic import Field

from sextant.config.schema.parts import Count, Node, Positive, Seed, Share
from sextant.config.schema.splits import BySplit, ImageSide


class ClassificationTask(Node):
    """Image classification."""

    name: Literal["classification"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    test_every: Count = Field(examples=[1])
    test_checkpoint: Literal["last", "best"]


class CalibrationTask(Node):
    """Calibration from one image."""

    name: Literal["calibration"]
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[72])
    crops_per_panorama: BySplit
    augment: bool
    features: Count = Field(examples=[256])
    coordinates: bool
    clip: Positive = Field(examples=[1.0])
    geometric_baselines: bool
    test_checkpoint: Literal["last", "best"]


Task = Annotated[ClassificationTask | CalibrationTask, Field(discriminator="name")]
