"""A whole run: all groups together, and the rules that join them."""

from typing import Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.augmentations import Augmentation
from sextant.config.schema.cameras import Loss, Parameterization, Sampling
from sextant.config.schema.corruptions import CorruptionSuite, TestConditions
from sextant.config.schema.datasets import Dataset
from sextant.config.schema.environment import Paths, Tracking, Trainer
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.optimization import Optimizer, Schedule
from sextant.config.schema.parts import CustomPart, Node, Part, Seed
from sextant.config.schema.sweeps import Sweep
from sextant.config.schema.tasks import Task

#: groups that one task alone uses, and whether it needs them
OWNED = {
    "augmentation": ("classification", False),
    "parameterization": ("calibration", True),
    "loss": ("calibration", True),
    "sampling": ("calibration", True),
    "test_sampling": ("calibration", False),
}


class Config(Node):
    """A whole run."""

    dataset: Dataset
    corruption: TestConditions
    backbone: Backbone
    inhibition: Inhibition
    optimizer: Optimizer
    schedule: Schedule
    trainer: Trainer
    tracking: Tracking
    paths: Paths
    task: Task
    augmentation: Augmentation | None = None
    parameterization: Parameterization | None = None
    loss: Loss | None = None
    sampling: Sampling | None = None
    test_sampling: Sampling | None = None
    seed: Seed = Field(examples=[0])
    init_from: str | None
    reuse: Literal["exact", "any_code"]
    sweep: Sweep | None = None

    @model_validator(mode="after")
    def _groups_belong_to_the_task(self) -> Self:
        for name, (task, needed) in OWNED.items():
            if self.task.name != task and getattr(self, name) is not None:
                raise ValueError(f"{name} belongs to task={task}; leave it out, or choose that task")
            if self.task.name == task and needed and getattr(self, name) is None:
                raise ValueError(f"{name} is missing: task={task} needs one")
        return self

    def custom_targets(self) -> list[str]:
        """Import paths in the config that Sextant has no schema for."""
        parts: list[Part] = [
            self.dataset,
            self.corruption,
            self.backbone,
            self.inhibition,
            self.optimizer,
            self.schedule,
        ]
        if isinstance(self.corruption, CorruptionSuite):
            parts += self.corruption.corruptions.values()
        parts += [part for part in (self.loss, self.augmentation) if part is not None]
        return [part.target for part in parts if isinstance(part, CustomPart)]
