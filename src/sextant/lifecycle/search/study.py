"""The trials of a search in Optuna's storage; the only module that imports Optuna."""

import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from cmaes import CMA
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.exceptions import ExperimentalWarning, StorageInternalError
from optuna.trial import TrialState
from sqlalchemy.exc import SQLAlchemyError

from sextant.addresses import sqlite_uri
from sextant.config.schema.searches import Dimension
from sextant.errors import UserError
from sextant.lifecycle.search.design import SearchDesign

Space = Mapping[str, Dimension]


def grid_point(space: Space, number: int) -> dict[str, Any]:
    """Point ``number`` of the grid of all combinations; the last key changes fastest."""
    point: dict[str, Any] = {}
    for key, found in reversed(list(space.items())):
        values = found.options or range(int(found.low), int(found.high) + 1)
        number, place = divmod(number, len(values))
        point[key] = values[place]
    return dict(reversed(point.items()))


def cma_point(space: Space, told: Sequence[tuple[Mapping[str, Any], float]], number: int, seed: int) -> dict[str, Any]:
    """The next point of CMA-ES after replaying all complete generations of ``told`` in order.

    Args:
        space: search space of two or more numbers, without choices.
        told: points with their values; higher is better, minus infinity is worst.
        number: number of the requested trial; its random numbers depend only on this and the seed.
        seed: seed of the search.

    References:
        Hansen, The CMA Evolution Strategy: A Tutorial, 2016.
    """
    count = len(space)
    evolution = CMA(mean=np.full(count, 0.5), sigma=1 / 6, bounds=np.tile([0.0, 1.0], (count, 1)), seed=seed)
    size = evolution.population_size
    for start in range(0, len(told) - size + 1, size):
        generation = told[start : start + size]
        worst = min((value for _, value in generation if math.isfinite(value)), default=0.0)
        evolution.tell([(_unit(space, params), -max(value, worst)) for params, value in generation])
    evolution.reseed_rng(int(np.random.SeedSequence([seed, number]).generate_state(1)[0]))
    return {key: _from_unit(found, share) for (key, found), share in zip(space.items(), evolution.ask(), strict=True)}


def _unit(space: Space, params: Mapping[str, Any]) -> np.ndarray:
    return np.array([_share(found, float(params[key])) for key, found in space.items()])


def _share(found: Dimension, value: float) -> float:
    """The position of a value within its bounds, from 0 to 1."""
    low, high, value = map(math.log if found.kind == "log_uniform" else float, (found.low, found.high, value))
    return (value - low) / (high - low)


def _from_unit(found: Dimension, share: float) -> float:
    """The value at a position within the bounds, rounded for whole numbers."""
    if found.kind == "log_uniform":
        low, high = math.log(found.low), math.log(found.high)
        return min(max(math.exp(low + share * (high - low)), found.low), found.high)
    value = min(max(found.low + share * (found.high - found.low), found.low), found.high)
    return round(value) if found.kind == "int" else value


IDENTITY = "sextant.search"


@dataclass(frozen=True)
class Asked:
    """A trial drawn from the sampler.

    Attributes:
        setting: the value of each key, as in an override.
        told: whether the end of the trial is recorded in the storage.
    """

    number: int
    setting: dict[str, str]
    told: bool


class Study:
    """The trials of one search, in a file of its folder or in PostgreSQL.

    Each trial gets a new sampler, seeded by the search's seed and the trial's number. A search that was killed
    therefore continues with the trials it would have drawn, and one whose storage is lost draws the same trials again.

    Args:
        design: design of the search.
        directory: folder of the search.

    Raises:
        UserError: the storage cannot be used, or holds a different search under this name.
    """

    def __init__(self, design: SearchDesign, directory: Path):
        self.design = design
        self.file = directory / "study.db"
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        directory.mkdir(parents=True, exist_ok=True)
        with self._telling_errors():
            self._study = optuna.create_study(
                storage=design.search.storage or sqlite_uri(self.file),
                study_name=design.name,
                direction=design.search.direction,
                load_if_exists=True,
            )
            known = self._study.user_attrs.get(IDENTITY)
            if known is None:
                self._study.set_user_attr(IDENTITY, json.dumps(design.identity, sort_keys=True))
            else:
                _require_same(design, json.loads(known))
            self._finish_asking()

    def trials(self) -> list[Asked]:
        """All trials, by number."""
        with self._telling_errors():
            return [
                Asked(trial.number, self._setting(trial.params), trial.state.is_finished())
                for trial in self._study.get_trials(deepcopy=False)
                if trial.state != TrialState.WAITING
            ]

    def ask(self) -> Asked:
        """Ask for a new trial."""
        trials = self.trials()
        with self._telling_errors():
            point = self._own_point(len(trials))
            waiting = self._study.get_trials(deepcopy=False, states=(TrialState.WAITING,))
            if point is not None and not waiting:
                self._study.enqueue_trial(point)
            self._study.sampler = self._sampler(len(trials))
            trial = self._study.ask()
            self._suggest(trial)
        return Asked(trial.number, self._setting(trial.params), told=False)

    def tell(self, number: int, value: float | None, *, diverged: bool = False) -> None:
        """Record how a trial ended: with a mean, or without one because it diverged (the worst result) or failed."""
        state = TrialState.COMPLETE if value is not None else TrialState.PRUNED if diverged else TrialState.FAIL
        with self._telling_errors():
            self._study.tell(number, value, state, skip_if_finished=True)

    def _own_point(self, number: int) -> dict[str, Any] | None:
        """The point imposed on Optuna: from a grid, or from CMA-ES replayed on the recorded results.

        Optuna's own CMA-ES sampler keeps its state pickled in the storage, and nothing read from a database may be
        executed.
        """
        search, space = self.design.search, self.design.space
        if search.method == "grid":
            return grid_point(space, number)
        if search.method != "cmaes":
            return None
        told = [
            (trial.params, self.design.sign * trial.value if trial.value is not None else -np.inf)
            for trial in self._study.get_trials(deepcopy=False)
            if trial.state in (TrialState.COMPLETE, TrialState.PRUNED)
        ]
        return cma_point(space, told, number, search.sampler_seed)

    def _sampler(self, *numbers: int) -> optuna.samplers.BaseSampler:
        seed = int(np.random.SeedSequence([self.design.search.sampler_seed, *numbers]).generate_state(1)[0])
        if self.design.search.method == "tpe":
            return optuna.samplers.TPESampler(seed=seed)
        return optuna.samplers.RandomSampler(seed=seed)

    def _suggest(self, trial: optuna.trial.Trial) -> None:
        """Draw a trial's values, each from its own random numbers, so that a kill between two draws changes neither."""
        for place, (key, found) in enumerate(self.design.space.items()):
            self._study.sampler = self._sampler(trial.number, place)
            trial._suggest(key, _distribution(found))

    def _finish_asking(self) -> None:
        """Draw the missing values of trials that a kill left incomplete."""
        for trial in self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            if len(trial.params) < len(self.design.space):
                self._study.sampler = self._sampler(trial.number)
                self._suggest(optuna.trial.Trial(self._study, trial._trial_id))

    def _setting(self, params: Mapping[str, Any]) -> dict[str, str]:
        return {key: found.text(params[key]) for key, found in self.design.space.items()}

    @contextmanager
    def _telling_errors(self) -> Iterator[None]:
        where = self.design.search.storage
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ExperimentalWarning)
                yield
        except ImportError as error:
            if where is None:
                raise
            raise UserError(
                f"sweep.search.storage={_shown(where)} needs a driver: {error}", "pip install psycopg2-binary"
            ) from None
        except (SQLAlchemyError, StorageInternalError) as error:
            said = str(error.__cause__ or error).splitlines()[0]
            if where is not None:
                raise UserError(
                    f"sweep.search.storage={_shown(where)} does not answer: {said}",
                    "Start the server, or leave the key out: the trials are kept in the sweep's folder then.",
                ) from None
            raise UserError(
                f"{self.file} cannot be used: {said}",
                "If it is damaged, delete it: the same trials are drawn again, and their runs are kept.",
            ) from None


def importances(
    settings: Sequence[Mapping[str, str]], values: Sequence[float], design: SearchDesign
) -> dict[str, float]:
    """The share of the metric's variance over the space that each key explains (functional ANOVA of a forest).

    Args:
        settings, values: settings and values of the trials that have a value.
        design: design of the search.

    Returns:
        Shares that sum to one, the largest first; empty with fewer than four trials or if all have the same value.

    References:
        Hutter, Hoos and Leyton-Brown, An Efficient Approach for Assessing Hyperparameter Importance, ICML 2014.
    """
    if len(values) < 4 or len(set(values)) < 2:
        return {}
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    space = {key: _distribution(found) for key, found in design.space.items()}
    study = optuna.create_study(direction=design.search.direction)
    for setting, value in zip(settings, values, strict=True):
        params = {key: _value(design.space[key], text) for key, text in setting.items()}
        study.add_trial(optuna.trial.create_trial(params=params, distributions=space, value=value))
    found = optuna.importance.get_param_importances(
        study, evaluator=optuna.importance.FanovaImportanceEvaluator(seed=0), params=list(space)
    )
    return {key: float(share) for key, share in found.items()}


def _value(found: Dimension, text: str) -> Any:
    """A value as Optuna holds it, clipped to its bounds, which rounding to six figures may exceed."""
    if found.kind == "choice":
        return text
    return int(text) if found.kind == "int" else min(max(float(text), found.low), found.high)


def _distribution(found: Dimension) -> BaseDistribution:
    if found.kind == "choice":
        return CategoricalDistribution(found.options)
    if found.kind == "int":
        return IntDistribution(int(found.low), int(found.high))
    return FloatDistribution(found.low, found.high, log=found.kind == "log_uniform")


def _require_same(design: SearchDesign, known: Mapping[str, Any]) -> None:
    """Raise a ``UserError`` that lists the differences unless a study belongs to this search."""
    wanted = design.identity
    differing = [key for key in wanted if wanted[key] != known.get(key)]
    if differing:
        told = "; ".join(f"{key} {_plain(known.get(key))} there, {_plain(wanted[key])} here" for key in differing)
        raise UserError(
            f"the storage holds another search under the name {design.name}: {told}",
            "Give this search another name: sweep.name=<name>",
        )


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {text}" for key, text in value.items()) + "}"
    return str(value)[:80]


def _shown(address: str) -> str:
    """A storage address without its password."""
    head, at, rest = address.rpartition("@")
    scheme, mark, who = head.partition("://")
    return f"{scheme}{mark}{who.partition(':')[0]}{at}{rest}" if at else address
