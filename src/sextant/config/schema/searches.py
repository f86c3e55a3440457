"""Searches over a space of configs."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from sextant.config.schema.parts import Count, Node, Seed, distinct
from sextant.config.schema.space import GRAMMAR, Dimension, dimension

Method = Literal["tpe", "cmaes", "random", "grid", "halving"]


def _first_seeds(value: Any) -> Any:
    """Expand a number n of seeds to 0, ..., n - 1."""
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a number of seeds must be at least 1, got {value}")
        return list(range(value))
    return value


Seeds = Annotated[list[Seed], Field(min_length=1), AfterValidator(distinct), BeforeValidator(_first_seeds)]


def _readable(value: Any) -> str:
    """Refuse text that is not a range of values; legal text is kept as written."""
    dimension(str(value))
    return str(value)


Range = Annotated[str, BeforeValidator(_readable)]


def _validation(metric: str) -> str:
    """Refuse a metric of the test split, as a choice based on it could not be tested any more."""
    if not metric.startswith("val/"):
        raise ValueError(f"a search looks at the validation split alone: val/..., got {metric!r}")
    return metric


class Search(Node):
    """A search for the best point of a space, with trials at several seeds each.

    Attributes:
        method: ``tpe`` is the tree-structured Parzen estimator, ``cmaes`` evolves a Gaussian over numbers, ``grid``
            tries all points, ``random`` draws them; ``halving`` (successive halving) draws all points first and
            repeatedly gives the better half twice the seeds.
        space: key -> range of its values.
        n_trials: total number of trials, however often the search is restarted.
        metric: validation metric as in ``metrics.json``; by default the one that selects the task's checkpoints.
        direction: the better direction of ``metric``.
        race: whether a trial that can no longer beat the best gets no further seed; otherwise each trial gets all.
        confidence: confidence of the one-sided paired interval for this decision.
        fresh_seeds: seeds at which the winner is tested; by default as many as it was chosen at, from 1,000 up.
        test_metric: metric reported for the winner; by default the counterpart of ``metric`` on the test split.
        parallel: number of runs that are started together.
        sampler_seed: seed of the method's random draws.
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
        """The parsed space."""
        return {key: dimension(text) for key, text in self.space.items()}

    @property
    def points(self) -> float:
        """The number of grid points; infinite if a number need not be whole."""
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
