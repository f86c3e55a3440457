"""The config of classification."""

from typing import Literal

from pydantic import Field

from sextant.config.schema.images import Augmentation
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.parts import Choice
from sextant.config.schema.run import Config, TaskNode
from sextant.ranges import Count, Seed, Share


class ClassificationTask(TaskNode):
    """Image classification."""

    name: Literal["classification"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    test_every: Count = Field(examples=[1])
    test_checkpoint: Literal["last", "best"]


class ClassificationConfig(Config):
    """The config of a run of classification."""

    task: ClassificationTask
    backbone: Choice[Backbone]
    inhibition: Choice[Inhibition]
    augmentation: Choice[Augmentation] | None = None


CONFIG = ClassificationConfig
