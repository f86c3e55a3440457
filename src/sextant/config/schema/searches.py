"""Searches over a space of configs."""

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from sextant.config.schema.parts import Node, distinct
from sextant.ranges import Count, Seed

Kind = Literal["uniform", "log_uniform", "int", "choice"]
WRITTEN = re.compile(r"\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.DOTALL)
GRAMMAR = "uniform(low, high), log_uniform(low, high), int(low, high) or choice(a, b, ...)"
#: significant digits of a tried number, so that it can be typed in an override
DIGITS = 6


@dataclass(frozen=True)
class Dimension:
    """The range of one key.

    Attributes:
        kind: ``int`` includes both bounds; ``log_uniform`` is uniform in the logarithm.
        low, high: bounds of a number; nan for a choice.
        options: options of a choice, as written in an override.
    """

    kind: Kind
    low: float = math.nan
    high: float = math.nan
    options: tuple[str, ...] = ()

    @property
    def size(self) -> float:
        """The number of values; infinite for numbers that need not be whole."""
        return len(self.options) or (self.high - self.low + 1 if self.kind == "int" else math.inf)

    @property
    def middle(self) -> str:
        """A value in the middle of the range, as text."""
        if self.kind == "choice":
            return self.options[0]
        both = (math.log(self.low), math.log(self.high)) if self.kind == "log_uniform" else (self.low, self.high)
        mean = sum(both) / 2
        return self.text(math.exp(mean) if self.kind == "log_uniform" else mean)

    @property
    def ends(self) -> tuple[str, ...]:
        """The values that reveal a mistake in the range: both bounds, or every option."""
        return self.options or (self.text(self.low), self.text(self.high))

    def text(self, value: object) -> str:
        """A value as written in an override, with numbers to six significant digits."""
        if self.kind == "choice":
            return str(value)
        number = float(str(value))
        return str(round(number)) if self.kind == "int" else repr(float(f"{number:.{DIGITS}g}"))


def is_dimension(value: object) -> bool:
    """Whether a value of an override is meant as a range, valid or not."""
    found = WRITTEN.fullmatch(value) if isinstance(value, str) else None
    return found is not None and found[1] in get_args(Kind)


def dimension(text: str) -> Dimension:
    """Parse the range of one key.

    Raises:
        ValueError: the text does not follow the grammar, has no bounds, or its bounds are not a range; the message says
            which.
    """
    found = WRITTEN.fullmatch(text)
    if found is None or found[1] not in get_args(Kind):
        raise ValueError(f"{text!r} is not a range of values; write {GRAMMAR}")
    kind: Kind = found[1]  # type: ignore[assignment]
    words = _split(found[2])
    if kind == "choice":
        if not words or not all(words) or len(set(words)) < len(words):
            raise ValueError(f"{text}: a choice is between different values, such as choice(adam, sgd)")
        return Dimension(kind, options=tuple(words))
    example = "int(1, 8)" if kind == "int" else f"{kind}(1e-4, 1e-1)"
    if len(words) != 2:
        raise ValueError(f"{text}: {kind} needs two bounds, such as {example}")
    try:
        low, high = (int(word) if kind == "int" else float(word) for word in words)
    except ValueError:
        kind_of = "whole numbers" if kind == "int" else "numbers"
        raise ValueError(f"{text}: the bounds of {kind} are {kind_of}, such as {example}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"{text}: the bounds must be finite, the lower one first")
    if kind == "log_uniform" and low <= 0:
        raise ValueError(f"{text}: a logarithm needs bounds above 0")
    return Dimension(kind, low, high)


def _split(text: str) -> list[str]:
    """Split at commas that are not within brackets or quotes."""
    words, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        depth += (letter in "([{") - (letter in ")]}") if not quote else 0
        if letter == "," and not depth and not quote:
            words.append("")
        else:
            words[-1] += letter
    return [word.strip() for word in words] if text.strip() else []


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
        raise ValueError(f"a search uses the validation split alone: val/..., got {metric!r}")
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
            raise ValueError("sweep.search.space.seed: a seed is not a setting; each trial is run at all sweep.seeds")
        if self.method == "grid" and math.isinf(self.points):
            key = next(key for key, kind in kinds.items() if "uniform" in kind)
            raise ValueError(
                f"sweep.search.space.{key}={self.space[key]}: a grid needs a finite number of values, and a range of "
                "numbers has none. List some, as in choice(0.01, 0.1), or use sweep.search=random"
            )
        if self.method == "cmaes" and ("choice" in kinds.values() or len(kinds) < 2):
            raise ValueError("sweep.search=cmaes needs two numbers or more, and no choice(...). Use sweep.search=tpe")
        return self
