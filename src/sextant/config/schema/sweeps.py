"""Ablations."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from sextant.config.schema.parts import Node
from sextant.config.schema.searches import Search, Seeds
from sextant.ranges import Count


def _block(given: object) -> str | None:
    """Refuse what is not ``k/n`` with 1 <= k <= n."""
    if given is None:
        return None
    text = str(given)
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise ValueError(f"{text} must be k/n, the k-th of n blocks. For example sweep.block=1/4")
    return text


class Arm(Node):
    """One arm of a sweep.

    Attributes:
        reads: method whose answers are compared, if a run has several; arms with the same overrides share their
            runs.
        only: values of factors; the arm runs in settings with one of these values; empty runs it in every setting.
    """

    overrides: list[str]
    reads: str | None = None
    only: list[str] = Field(default_factory=list)
    seed_offset: int = Field(default=0, ge=0)


class Contrast(Node):
    """Treatment against control, at the same seeds unless an arm shifts them."""

    treatment: str
    control: str


class Sweep(Node):
    """A named ablation: factors x arms x seeds. It is not part of the digest, as it plans runs but changes none.

    Attributes:
        worlds: the key that names the world of a run, with its values: ``{dataset.world: [1, 2, 3]}``, or ``{dataset:
            [gardens_point, sped]}`` of real data. Every arm runs in each of them at each of the seeds. The world is
            then the replicate: its seeds are averaged, and intervals are over worlds.
        seeds_of: largest number of seeds of the settings with a value of a factor, by that value.
        block: ``k/n``: run only the k-th of n blocks, which are cut between settings and seeds; None runs all.
        interval: kind of the intervals of contrasts: Student's t.
        quick: overrides of its small form for ``preset=quick``; empty if it is already small.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_-]+$", max_length=200, examples=["my_sweep"])
    question: str = ""
    factors: dict[str, Annotated[list[str | int | float | bool], Field(min_length=1)]] = Field(default_factory=dict)
    arms: dict[str, Arm] = Field(default_factory=dict)
    seeds: Seeds = Field(default=[0], examples=[8])
    worlds: dict[str, Annotated[list[str | int], Field(min_length=2)]] = Field(default_factory=dict, max_length=1)
    seeds_of: dict[str, Count] = Field(default_factory=dict)
    block: Annotated[str | None, BeforeValidator(_block)] = Field(default=None, examples=["1/4"])
    contrasts: dict[str, Contrast] = Field(default_factory=dict)
    noise_floor: str | None = None
    published: dict[str, dict[str, dict[str, float]]] = Field(default_factory=dict)
    interval: Literal["t", "bootstrap"] = "t"  # all are t; runs of 0.1 may hold the other
    metrics: list[str] = Field(default_factory=list)
    quick: list[str] | None = None
    search: Search | None = None

    @model_validator(mode="after")
    def _search_or_factors(self) -> Self:
        if self.search is None:
            return self
        if self.factors or self.arms or self.contrasts or self.worlds:
            raise ValueError(
                "sweep.search compares its own trials: it cannot be combined with factors, arms, contrasts or worlds"
            )
        if both := set(self.seeds) & set(self.search.fresh_seeds or ()):
            raise ValueError(f"sweep.search.fresh_seeds={sorted(both)}: the winner is chosen at these; name others")
        return self

    @model_validator(mode="after")
    def _worlds_differ(self) -> Self:
        for key, values in self.worlds.items():
            if len({str(value) for value in values}) < len(values):
                raise ValueError(f"sweep.worlds.{key}={values}: worlds must differ")
            if key in self.factors:
                raise ValueError(f"sweep.factors.{key}: {key} is the replicate of sweep.worlds")
        return self

    @model_validator(mode="after")
    def _settings_are_of_factors(self) -> Self:
        known = [str(value) for values in self.factors.values() for value in values]
        told = f"factors have the values {', '.join(known)}" if known else "the sweep has no factors"
        named = {f"arms.{name}.only": value for name, arm in self.arms.items() for value in arm.only}
        for key, value in {**named, **{f"seeds_of.{value}": value for value in self.seeds_of}}.items():
            if value not in known:
                raise ValueError(f"sweep.{key} names {value}; {told}")
        return self

    @model_validator(mode="after")
    def _contrasts_name_arms(self) -> Self:
        for name, contrast in self.contrasts.items():
            for arm in (contrast.treatment, contrast.control):
                if arm not in self.arms:
                    raise ValueError(f"sweep.contrasts.{name} names the arm {arm!r}; arms are {', '.join(self.arms)}")
        if self.noise_floor is not None and self.noise_floor not in self.contrasts:
            raise ValueError(f"sweep.noise_floor={self.noise_floor} must be one of {', '.join(self.contrasts)}")
        return self
