"""Test conditions."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from sextant.config.schema.parts import Choice, NonNegative, Part, Positive, Seed, distinct


class Corruption(Part):
    """One corruption at its severities."""


class GaussianNoise(Corruption):
    """Additive Gaussian noise."""

    target: Literal["sextant.corruptions.GaussianNoise"] = Field(alias="_target_")
    levels: Annotated[list[NonNegative], AfterValidator(distinct)] = Field(min_length=1, examples=["[0.01,0.1]"])
    clip: bool


class ContrastPoisson(Corruption):
    """Loss of contrast, then photon noise."""

    target: Literal["sextant.corruptions.ContrastPoisson"] = Field(alias="_target_")
    levels: Annotated[list[Annotated[float, Field(gt=0, le=1)]], AfterValidator(distinct)] = Field(
        min_length=1, examples=["[0.5,0.2]"]
    )
    peak: Positive = Field(examples=[256.0])
    clip: bool


class TestConditions(Part):
    """The conditions under which a model is tested."""


class CorruptionSuite(TestConditions):
    """The test conditions."""

    target: Literal["sextant.corruptions.CorruptionSuite"] = Field(alias="_target_")
    corruptions: dict[str, Choice[Corruption]]
    seed: Seed = Field(examples=[0])


class BenchmarkSuite(TestConditions):
    """A published set of test conditions."""

    target: Literal["sextant.corruptions.BenchmarkSuite"] = Field(alias="_target_")
    set: Literal["cifar10_c", "mnist_c", "imagenet_c"]
    names: str | list[str] | None = Field(examples=["benchmark15"])
    severities: Annotated[list[int], AfterValidator(distinct)] | None = Field(examples=["[1,3,5]"])
    mode: Literal["faithful", "corrected"]
    quantise: bool
    seed: Seed = Field(examples=[0])
    beside: dict[str, Choice[Corruption]] | None = None


class StoredSuite(TestConditions):
    """A published set of test conditions, from files."""

    target: Literal["sextant.corruptions.StoredSuite"] = Field(alias="_target_")
    folder: str = Field(examples=["CIFAR-10-C"])
    set: Literal["cifar10_c", "mnist_c", "imagenet_c"]
    names: str | list[str] | None = Field(examples=["benchmark15"])
    severities: Annotated[list[int], AfterValidator(distinct)] | None = Field(examples=["[1,3,5]"])


class PerturbationSuite(TestConditions):
    """Sequences in which an image changes gradually."""

    target: Literal["sextant.corruptions.PerturbationSuite"] = Field(alias="_target_")
    names: list[str] | None = Field(examples=["[translate,rotate]"])
    seed: Seed = Field(examples=[0])
