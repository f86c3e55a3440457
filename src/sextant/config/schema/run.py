"""The part of a config common to all tasks, and the rules across groups."""

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from sextant.config.schema.images import Dataset, TestConditions
from sextant.config.schema.launchers import AnyLauncher, LocalLauncher
from sextant.config.schema.parts import Choice, CustomPart, Node, known_targets, named_targets, targets_of
from sextant.config.schema.sweeps import Sweep
from sextant.config.schema.training import Debug, Optimizer, Paths, Schedule, Tracking, Trainer
from sextant.moved import with_present_names
from sextant.ranges import Seed

#: groups that every config listed when digests were first taken, those of other tasks as null
LISTED = (
    *("backbone", "inhibition", "augmentation", "parameterization", "loss", "sampling", "test_sampling", "pooling"),
    *("mining", "descriptor", "kernel", "observation", "likelihood", "motion", "filter", "recovery", "fault", "faults"),
    *("features", "bank", "strategy", "filters"),
)
#: groups that were added later: absent where they are null or empty, so that earlier configs keep their digest
ADDED = ("debug", "local")


class TaskNode(Node):
    """Settings common to all tasks."""

    name: str
    test_checkpoint: Literal["last", "best"]


class Config(Node):
    """The config of a whole run, common to all tasks. A chapter's own class adds its groups; a field that may be null
    is optional for its task."""

    model_config = ConfigDict(defer_build=True)  # the data sets of all chapters are known once all are imported

    _plain: Mapping[str, Any] = PrivateAttr(default_factory=dict)
    dataset: Choice[Dataset]
    corruption: Choice[TestConditions]
    optimizer: Choice[Optimizer]
    schedule: Choice[Schedule]
    trainer: Trainer
    tracking: Tracking
    paths: Paths
    task: TaskNode
    seed: Seed = Field(examples=[0])
    init_from: str | None
    reuse: Literal["exact", "any_code"]
    sweep: Sweep | None = None
    debug: Debug | None = None
    launcher: AnyLauncher = Field(default_factory=LocalLauncher)

    @property
    def plain(self) -> Mapping[str, Any]:
        """The original values, by present names; parts are built from these, and checkpoints store them."""
        return self._plain

    @model_validator(mode="wrap")
    @classmethod
    def _keep_plain(cls, values: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        values = with_present_names(values)
        if not isinstance(values, Mapping):
            return handler(values)
        given = {key: value for key, value in values.items() if value or key not in ADDED}
        config = handler({key: value for key, value in given.items() if value is not None or key not in LISTED})
        config._plain = values
        return config

    @model_validator(mode="after")
    def _parts_are_of_their_group(self) -> Self:
        known = known_targets()
        for name, value in self:
            if isinstance(value, CustomPart) and value.target in known:
                taken = ", ".join(sorted(targets_of(type(self).model_fields[name].annotation)))
                raise ValueError(f"{name}={value.target} is not one of task={self.task.name}, which takes {taken}")
        return self

    @model_serializer(mode="wrap")
    def _as_before(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        found = {key: value for key, value in handler(self).items() if value is not None or key not in ADDED}
        return {**dict.fromkeys(LISTED), **found}

    def custom_parts(self) -> dict[str, str]:
        """Import paths without a schema in Sextant, anywhere in the config, by their dotted keys."""
        known = known_targets()
        return {key: path for key, path in named_targets(self.model_dump(by_alias=True)) if path not in known}

    def custom_targets(self) -> list[str]:
        """The same import paths without their keys."""
        return list(dict.fromkeys(self.custom_parts().values()))
