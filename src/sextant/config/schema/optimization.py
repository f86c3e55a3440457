"""Optimisers and learning rate schedules."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import NonNegative, Part, Positive, Share


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
