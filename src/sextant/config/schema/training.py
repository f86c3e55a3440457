"""Settings of training, tracking and file locations."""

import os
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from sextant.config.schema.parts import Node, Part
from sextant.ranges import Count, NonNegative, Positive, Share

Folder = Annotated[str, AfterValidator(os.path.expanduser)]


class Trainer(Node):
    """Settings of training.

    Attributes:
        devices: number of processes that train one network, each on its own device: a GPU, or a share of the cores.
        precision: precision of the network; a processor without bfloat16 uses float32 for ``bf16-mixed`` and logs it.
        batch_size: images per batch over all processes, not counting ``accumulate``.
        accumulate: number of batches whose gradients are averaged for a step.
        patience: epochs without a better validation metric after which training ends; null trains all epochs.
        compile: whether the network is compiled by ``torch.compile`` for training.
    """

    accelerator: Literal["cpu", "gpu"]
    devices: int = Field(ge=1, le=64, examples=[1])
    precision: Literal["32-true", "16-mixed", "bf16-mixed"]
    deterministic: bool
    threads: int = Field(ge=1, le=256, examples=[1])
    max_epochs: Count = Field(examples=[12])
    batch_size: Count = Field(examples=[128])
    accumulate: Count = Field(default=1, examples=[4])
    patience: Count | None = Field(default=None, examples=[5])
    compile: bool = False
    eval_batch_size: Count = Field(examples=[1000])
    log_every: int = Field(ge=20, examples=[50])
    workers: int = Field(ge=0, le=64, examples=[0])
    progress: bool

    @model_validator(mode="after")
    def _half_precision_needs_a_gpu(self) -> Self:
        if self.accelerator == "cpu" and self.precision == "16-mixed":
            raise ValueError("trainer.precision=16-mixed needs trainer=gpu; on the CPU use 32-true or bf16-mixed")
        return self

    @model_validator(mode="after")
    def _every_process_has_an_image(self) -> Self:
        if self.devices > self.batch_size:
            raise ValueError(
                f"trainer.devices={self.devices} cannot share batches of {self.batch_size}; "
                f"set trainer.batch_size={self.devices} at least"
            )
        if self.accumulate > self.log_every:
            raise ValueError(f"trainer.accumulate={self.accumulate} must be at most trainer.log_every={self.log_every}")
        return self


class Debug(Node):
    """What is changed to find a fault.

    Attributes:
        batches: batches of each split; null for all.
        overfit: batches that are repeated in every epoch; null for none.
        profile: whether the time of each hook is written.
        nan: whether the first value that is not finite stops the run and is kept.
    """

    batches: Count | None = Field(examples=[1])
    overfit: Count | None = Field(examples=[3])
    profile: bool
    nan: bool

    @model_validator(mode="after")
    def _one_limit(self) -> Self:
        if self.batches is not None and self.overfit is not None:
            raise ValueError("debug.batches and debug.overfit exclude each other: set one of them to null")
        return self


class Tracking(Node):
    """Where runs are logged."""

    kind: Literal["sqlite", "server", "none"]
    uri: str | None = Field(examples=["http://127.0.0.1:5000"])
    experiment: str | None = Field(min_length=1, max_length=500, examples=["lenet"])
    system_metrics: bool
    system_metrics_every_s: Positive = Field(examples=[10])
    log_checkpoint: bool
    parent_run: str | None
    also: list[Literal["tensorboard", "csv", "wandb"]] = Field(default_factory=list, examples=["[csv]"])

    @model_validator(mode="after")
    def _server_needs_an_address(self) -> Self:
        if self.kind == "server" and not (self.uri or "").startswith(("http://", "https://")):
            raise ValueError(
                f"tracking.uri={self.uri} must start with http:// or https://; "
                "for example tracking=server tracking.uri=http://127.0.0.1:5000"
            )
        if self.kind == "sqlite" and self.uri is not None:
            raise ValueError(
                f"tracking.uri={self.uri} belongs to tracking=server; the sqlite store is in paths.outputs"
            )
        return self


class Paths(Node):
    """Locations of data, outputs and cache, and the folder from which relative paths start."""

    data: Folder
    outputs: Folder = Field(min_length=1, examples=["outputs"])
    cache: Folder
    here: str | None = None


class Optimizer(Part):
    """An optimiser of torch, whose parameters are passed later."""


class SGD(Optimizer):
    """Stochastic gradient descent."""

    target: Literal["torch.optim.SGD"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.1])
    momentum: float = Field(ge=0, lt=1, examples=[0.9])
    nesterov: bool
    weight_decay: NonNegative = Field(examples=[0.0005])

    @model_validator(mode="after")
    def _nesterov_needs_momentum(self) -> Self:
        if self.nesterov and self.momentum == 0:
            raise ValueError("optimizer.nesterov=true needs optimizer.momentum above 0, for example 0.9")
        return self


class Adam(Optimizer):
    """Adam."""

    target: Literal["torch.optim.Adam"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.001])
    betas: list[Annotated[float, Field(ge=0, lt=1)]] = Field(min_length=2, max_length=2, examples=["[0.9,0.999]"])
    weight_decay: NonNegative = Field(examples=[0.0])


class AdamW(Optimizer):
    """AdamW."""

    target: Literal["torch.optim.AdamW"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.001])
    betas: list[Annotated[float, Field(ge=0, lt=1)]] = Field(min_length=2, max_length=2, examples=["[0.9,0.999]"])
    weight_decay: NonNegative = Field(examples=[0.01])


class Schedule(Part):
    """The learning rate over the course of a run."""


class ConstantRate(Schedule):
    """A constant learning rate."""

    target: Literal["sextant.training.schedules.ConstantRate"] = Field(alias="_target_")


class StepDecay(Schedule):
    """A learning rate that decays in steps."""

    target: Literal["sextant.training.schedules.StepDecay"] = Field(alias="_target_")
    at: list[Share] = Field(examples=["[0.5,0.75]"])
    factor: Share = Field(examples=[0.1])

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if sorted(set(self.at)) != self.at:
            raise ValueError(f"schedule.at must ascend, got {self.at}")
        return self


class CosineDecay(Schedule):
    """A learning rate that decays along half a cosine."""

    target: Literal["sextant.training.schedules.CosineDecay"] = Field(alias="_target_")
