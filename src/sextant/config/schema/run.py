"""The config of a whole run: all groups, and the rules across them."""

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, PrivateAttr, model_validator

from sextant.config.names import with_present_names
from sextant.config.schema.calibration import CameraLoss, Panoramas, Parameterization, Sampling
from sextant.config.schema.classification import Augmentation, LabelledImages, TestConditions
from sextant.config.schema.cosfire import Bank, Features, Filters, Strategy
from sextant.config.schema.launchers import AnyLauncher, LocalLauncher
from sextant.config.schema.localization import (
    Descriptor,
    Drives,
    Fault,
    FaultSuite,
    Likelihood,
    Motion,
    Observation,
    ParticleFilter,
    PoseKernel,
    Recovery,
)
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.parts import Choice, CustomPart, Node, Seed, known_targets, named_targets
from sextant.config.schema.places import Mining, PlaceLoss, Places, Pooling
from sextant.config.schema.sweeps import Sweep
from sextant.config.schema.tasks import Task, owners
from sextant.config.schema.training import Optimizer, Paths, Schedule, Tracking, Trainer
from sextant.config.schema.world_datasets import World


class Config(Node):
    """The config of a whole run."""

    _plain: Mapping[str, Any] = PrivateAttr(default_factory=dict)
    dataset: Choice[LabelledImages | Panoramas | Places | Drives | World]
    corruption: Choice[TestConditions]
    optimizer: Choice[Optimizer]
    schedule: Choice[Schedule]
    trainer: Trainer
    tracking: Tracking
    paths: Paths
    task: Task
    backbone: Choice[Backbone] | None = None
    inhibition: Choice[Inhibition] | None = None
    augmentation: Choice[Augmentation] | None = None
    parameterization: Parameterization | None = None
    loss: Choice[CameraLoss | PlaceLoss] | None = None
    sampling: Sampling | None = None
    test_sampling: Sampling | None = None
    pooling: Choice[Pooling] | None = None
    mining: Choice[Mining] | None = None
    descriptor: Choice[Descriptor] | None = None
    kernel: PoseKernel | None = None
    observation: Choice[Observation] | None = None
    likelihood: Likelihood | None = None
    motion: Choice[Motion] | None = None
    filter: ParticleFilter | None = None
    recovery: Choice[Recovery] | None = None
    fault: Choice[Fault] | None = None
    faults: FaultSuite | None = None
    features: Features | None = None
    bank: Choice[Bank] | None = None
    strategy: Choice[Strategy] | None = None
    filters: Filters | None = None
    seed: Seed = Field(examples=[0])
    init_from: str | None
    reuse: Literal["exact", "any_code"]
    sweep: Sweep | None = None
    launcher: AnyLauncher = Field(default_factory=LocalLauncher)

    @property
    def plain(self) -> Mapping[str, Any]:
        """The original values, by present names; parts are built from these, and checkpoints store them."""
        return self._plain

    @model_validator(mode="wrap")
    @classmethod
    def _keep_plain(cls, values: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        values = with_present_names(values)
        config = handler(values)
        if isinstance(values, Mapping):
            config._plain = values
        return config

    @model_validator(mode="after")
    def _groups_belong_to_the_task(self) -> Self:
        for name, tasks in owners().items():
            if self.task.name not in tasks and getattr(self, name) is not None:
                raise ValueError(f"{name} belongs to task={' or '.join(tasks)}; leave it out, or choose that task")
            if name in self.task.needs and getattr(self, name) is None:
                raise ValueError(f"{name} is missing: task={self.task.name} needs one")
        if self.loss is not None and not isinstance(self.loss, self.task.loss_kind | CustomPart):
            raise ValueError(f"loss={self.loss.target} is not one of task={self.task.name}")
        return self

    def custom_parts(self) -> dict[str, str]:
        """Import paths without a schema in Sextant, anywhere in the config, by their dotted keys."""
        known = known_targets()
        return {key: path for key, path in named_targets(self.model_dump(by_alias=True)) if path not in known}

    def custom_targets(self) -> list[str]:
        """The same import paths without their keys."""
        return list(dict.fromkeys(self.custom_parts().values()))
