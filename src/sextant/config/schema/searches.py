"""Searches over a space of configs."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from sextant.config.schema.parts import Count, Node, Seed, distinct
from sextant.config.schema.space import GRAMMAR, Dimension, dimension

Method = Literal["tpe", "cmaes", "random", "grid", "halving"]


def _first_seeds(value: Any) -> Any:
    """A number n of seeds stands for 0 to n - 1."""
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a number of seeds must be at least 1, got {value}")
        return list(range(value))
    return value


Seeds = Annotated[list[Seed], Field(min_length=1), AfterValidator(distinct), BeforeValidator(_first_seeds)]


def _readable(value: Any) -> str:
    """Refuse what is no range of values; it is kept as it is written."""
    dimension(str(value))
    return str(value)


Range = Annotated[str, BeforeValidator(_readable)]


def _validation(metric: str) -> str:
    """Refuse a metric of the test split: what is chosen by it could not be tested any more."""
    if not metric.startswith("val/"):
        raise ValueError(f"a search looks at the validation split alone: val/..., got {metric!r}")
    return metric


class Search(Node):
    """Trials of points of a space, each at several seeds, in search of the best.

    Attributes:
        method: ``tpe`` is the tree-structured Parzen estimator, ``cmaes`` evolves a Gaussian of numbers, ``grid`` goes
            through all points, ``random`` draws them; ``halving`` draws them all and gives twice the seeds to the
            better half of them, again and again.
        space: key -> what it may be.
        n_trials: how many points are tried in all, however often the search is started again.
        metric: of the validation split, as in ``metrics.json``; by default the one that chooses the task's checkpoints.
        direction: in which ``metric`` is better.
        race: whether a trial that cannot beat the best any more gets no further seed; otherwise each gets all.
        confidence: of the one-sided paired interval by which it cannot.
        fresh_seeds: at which the winner is tested; by default as many as it was chosen at, from 1,000 up.
        test_metric: reported of the winner; by default the counterpart of ``metric`` on the test split.
        parallel: how many runs are started together.
        sampler_seed: of what the method draws.
        storage: a ``postgresql://`` address; by default a file in the sweep's folder.
    """

    method: Method = Field(default="tpe", examples=["tpe"])
    space: dict[str, Range] = Field(default_factory=dict, examples=["{optimizer.lr: 'log_uniform(1e-4, 1e-1)'}"])
    n_trials: Count = Field(default=20, examples=[20])
    metric: Annotated[str, AfterValidator(_validation)] | None = None
    direction: Literal["maximize", "minimize"] | None = None
    race: bool = True
    confidence: float = Field(default=0.95, gt=0.5, lt=1, examples=[0.95])
    fresh_seeds: Seeds | None = None
    test_metric: str | None = None
    parallel: Count = Field(default=1, examples=[2])
    sampler_seed: Seed = 0
    storage: str | None = Field(default=None, pattern=r"^postgresql(\+\w+)?://")

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The space as it is understood."""
        return {key: dimension(text) for key, text in self.space.items()}

    @property
    def points(self) -> float:
        """How many points a grid has; infinite where a number is not whole."""
        return math.prod(found.size for found in self.dimensions.values())

    @model_validator(mode="after")
    def _method_suits_the_space(self) -> Self:
        kinds = {key: found.kind for key, found in self.dimensions.items()}
        if not kinds:
            raise ValueError(f"sweep.search.space is empty: nothing to search. Give keys a range: {GRAMMAR}")
        if "seed" in kinds:
            raise ValueError("sweep.search.space.seed: a seed is no setting; each trial is run at all sweep.seeds")
        if self.method == "grid" and math.isinf(self.points):
            key = next(key for key, kind in kinds.items() if "uniform" in kind)
            raise ValueError(
                f"sweep.search.space.{key}={self.space[key]}: a grid goes through values, and a range of numbers has "
                "no end of them. List some, as in choice(0.01, 0.1), or use sweep.search=random"
            )
        if self.method == "cmaes" and ("choice" in kinds.values() or len(kinds) < 2):
            raise ValueError("sweep.search=cmaes needs two numbers or more, and no choice(...). Use sweep.search=tpe")
        return self
