"""The measure of a report: how images become one number per run, in which unit, and which direction is better."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from sextant.errors import UserError
from sextant.evaluation import BENCHMARK_15, CorruptionErrors, mean_interval, share_interval
from sextant.evaluation.shares import median_error

CLEAN = "clean"


@dataclass(frozen=True)
class SharedSet:
    """The conditions of a published set that the tested runs of a sweep share.

    A run states its set as ``protocol`` in its ``metrics.json`` (:class:`~sextant.corruptions.Protocol`). A sweep is
    reported as errors under a set if every tested run has a protocol and they share a corruption. Runs tested under
    custom conditions are reported as accuracies.

    Attributes:
        tested: the distinct test sets, as pairs of key and description of how their images were made; more than one if
            runs were tested on different images.
        severities: severities of the shared conditions, by corruption in the order of the test.
        left_out: number of conditions under which only some runs were tested.
        beside: keys of shared conditions outside the set, by corruption.
    """

    tested: tuple[tuple[str, str], ...]
    severities: Mapping[str, tuple[int, ...]]
    left_out: int = 0
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def of(self, corruption: str) -> list[str]:
        """The keys of the conditions of one corruption."""
        return [f"{corruption}/{severity}" for severity in self.severities[corruption]]

    @property
    def keys(self) -> list[str]:
        """The keys of all shared conditions, ``clean`` first."""
        return [CLEAN, *(key for corruption in self.severities for key in self.of(corruption))]

    @property
    def key(self) -> str | None:
        """The set that all runs name; None if they name several."""
        names = {name for name, _ in self.tested}
        return names.pop() if len(names) == 1 else None

    def describe(self) -> str:
        """The titles of the sets, and how their images were made."""
        return "; or ".join(description for _, description in self.tested)


def shared_set(protocols: Sequence[Mapping[str, Any] | None], conditions: Sequence[Sequence[str]]) -> SharedSet | None:
    """The conditions of a published set that runs share; None unless each of them was tested under one.

    Args:
        protocols: protocol of each tested run; None for custom conditions.
        conditions: keys of each run's conditions, in the order of the test.
    """
    known = [(str(protocol["set"]), _description(protocol)) for protocol in protocols if protocol and "set" in protocol]
    if not known or len(known) < len(protocols):
        return None
    shared = [key for key in conditions[0] if all(key in keys for keys in conditions)]
    of_sets = {name for protocol in protocols if protocol for name in protocol.get("severities", ())}
    severities: dict[str, tuple[int, ...]] = {}
    beside: dict[str, tuple[str, ...]] = {}
    for key in shared:
        corruption, _, severity = key.rpartition("/")
        if corruption and (corruption in of_sets or not of_sets):
            severities[corruption] = (*severities.get(corruption, ()), int(severity))
        elif corruption:
            beside[corruption] = (*beside.get(corruption, ()), key)
    if CLEAN not in shared or not severities:
        return None
    left_out = len({key for keys in conditions for key in keys} - set(shared))
    return SharedSet(tuple(dict.fromkeys(known)), severities, left_out, beside)


def _description(protocol: Mapping[str, Any]) -> str:
    return f"{protocol['title']}, {protocol['mode']}, {protocol['rounding']}, seed {protocol['seed']}"


Images = Float[ndarray, "images"]


@dataclass(frozen=True)
class Measure:
    """How the test images of one run are summarised.

    Attributes:
        title: heading of the table of cells.
        quantity: name of the values, in a word.
        unit: unit of all values, such as ``%``; empty if conditions have their own units.
        difference: name of the values of a contrast.
        statistic: statistic over the images of a run. Means can be compared image by image, medians only run by run.
        better: whether higher or lower is better.
        diverged: when a run counts as diverged, in words for the reader.
        trained_by: keys for the length of training, as longer training may help a diverged run.
        remedy: what to try without such keys.
        digits: number of decimals.
        items: name of the test items, each of which has a value.
        metrics: metrics that a report tabulates beside the measure, unless the sweep names others; see
            :mod:`~sextant.reports.metric`.
    """

    title: str
    quantity: str
    difference: str
    statistic: Literal["mean", "median"]
    better: Literal["higher", "lower"]
    diverged: str
    trained_by: tuple[str, ...] = ("trainer.max_epochs", "trainer.batch_size")
    remedy: str = ""
    unit: str = "%"
    digits: int = 2
    items: str = "images"
    metrics: tuple[str, ...] = ()

    @property
    def is_share(self) -> bool:
        """Whether the number of a run is a share, in per cent."""
        return self.unit == "%"

    @property
    def largest(self) -> float:
        """The largest possible difference in either direction."""
        return 100.0 if self.is_share else math.inf

    def interval(self, values: Float[ndarray, "seeds"], trials: int) -> tuple[float, float]:
        """The 95 % interval of the mean over seeds; for shares it stays within 0 and 100, otherwise it is Student's t.

        Args:
            values: one value per run.
            trials: total number of trials of all runs.
        """
        if not self.is_share:
            return mean_interval(values)
        low, high = share_interval(values / 100, trials)
        return (100 * low, 100 * high)

    def of_published(self, accuracy: float) -> float:
        """A published figure in this measure's unit; sweeps give those of classifiers as accuracies in per cent."""
        return 100 - accuracy if self.quantity == "error" else accuracy

    def of(self, images: Images) -> float:
        """The number of a run; a nan counts as an infinite error."""
        if self.statistic == "mean":
            return float(images.mean())
        return median_error(images)


ACCURACY = Measure(
    "Accuracy on the test split, per cent",
    "accuracy",
    "difference in accuracy (points)",
    "mean",
    "higher",
    "its validation accuracy after training is nearer to chance than to 1",
)
#: measure of runs tested under a published set of corruptions, whose literature reports errors
CORRUPTION_ERROR = Measure(
    "Errors on the test split, per cent; lower is better",
    "error",
    "difference in error (points)",
    "mean",
    "lower",
    ACCURACY.diverged,
)
#: prefixes of the arrays of a classifier that hold its confidence and the negative log-likelihood of the true class
BELIEVED = ("confidence/", "nll/")
#: name of the mean over corruptions, and prefix of the arrays of corrupted images: answers by method and condition key,
#: and whether runs along drives succeeded
CORRUPTED = "corrupted"
#: prefix of the arrays of recognition by filters that hold the answers of a method
ANSWERS = "answer/"
#: prefix of the arrays of a calibration run that hold a method's bearing errors
BEARINGS = "bearing_deg/"
#: prefix of those that mark the test images of a condition
UNDER = "condition/"


@dataclass(frozen=True)
class RunValues:
    """Values derived from the arrays of one run.

    Attributes:
        measure: the measure of the values.
        by_condition: the value of each test image under each condition of the report.
        errors: errors by corruption and severity, for a run under a published set.
        metrics: metrics computed from the arrays, to check that they belong to the run's ``metrics.json``.
    """

    measure: Measure
    by_condition: dict[str, Images]
    errors: CorruptionErrors | None = None
    metrics: Mapping[str, float] = field(default_factory=dict)


def require_answers(arrays: Mapping[str, ndarray], reads: str) -> None:
    """Raise a ``UserError`` unless a run has the answers of the method that an arm reads."""
    methods = [key.removeprefix(of) for of in (ANSWERS, BEARINGS) for key in arrays if key.startswith(of)]
    if reads not in methods:
        raise UserError(
            f"an arm of the sweep reads the answers of {reads}; its runs have those of "
            f"{', '.join(methods) or 'one method alone'}",
            "Correct the arm's reads, and run the sweep again.",
        )


def classified(arrays: Mapping[str, ndarray], shared: SharedSet | None = None) -> RunValues:
    """Accuracy under each condition of the test, or errors under a published set of corruptions.

    Under a set the report has few conditions: ``clean``, ``corrupted`` (the mean over severities, then over all shared
    corruptions), if more corruptions than those are shared ``benchmark 15``, and each corruption outside the set. The
    value of an image is 100 times the mean of 0 (right) and 1 (wrong), so that its mean over images is the error in per
    cent.

    Args:
        arrays: arrays of the run's ``predictions.npz``.
        shared: the conditions of a published set that all runs share, if they were tested under one.

    Raises:
        KeyError: the arrays are not those of such a run.
    """
    if shared is None:
        right = {key: 100.0 * (arrays[key] == arrays["labels"]) for key in conditions_in(arrays)}
        return RunValues(ACCURACY, right, metrics=accuracy_metrics(right) | _trust(arrays))
    wrong = {
        key: np.asarray(arrays[key] != arrays["labels"]) for key in (*shared.keys, *sum(shared.beside.values(), ()))
    }
    values = {"clean": 100.0 * wrong["clean"]}
    for title, names in summary_conditions(shared).items():
        values[title] = 100.0 * np.mean([_over_severities(wrong, shared, name) for name in names], axis=0)
    for name, keys in shared.beside.items():
        values[name] = 100.0 * np.mean([wrong[key] for key in keys], axis=0)
    errors = CorruptionErrors.of_conditions({key: float(wrong[key].mean()) for key in shared.keys})
    right = {key: 100.0 * ~images for key, images in wrong.items()}
    return RunValues(CORRUPTION_ERROR, values, errors, accuracy_metrics(right) | _trust(arrays))


def conditions_in(arrays: Iterable[str]) -> list[str]:
    """The keys of the arrays of a classifier that hold predictions: all but the labels and its confidence."""
    return [key for key in arrays if key != "labels" and not key.startswith(BELIEVED)]


def summary_conditions(shared: SharedSet) -> dict[str, tuple[str, ...]]:
    """The conditions of a report other than ``clean``, with the corruptions over which each is averaged."""
    everything = tuple(shared.severities)
    conditions = {"corrupted": everything}
    if set(BENCHMARK_15) < set(everything):
        conditions["benchmark 15"] = BENCHMARK_15
    return conditions


def accuracy_metrics(right: Mapping[str, Images]) -> dict[str, float]:
    """Accuracies as metrics, from values of 0 or 100 per image."""
    return {f"test/accuracy/{name}": float(images.mean()) / 100 for name, images in right.items()}


def over_corruptions(values: Mapping[str, Images], of: str) -> Images | None:
    """Per image, the mean of ``corrupted/<of>/<corruption>/<severity>`` over severities, then corruptions; or None."""
    prefix = f"{CORRUPTED}/{of}/"
    by_corruption: dict[str, list[Images]] = {}
    for key, found in values.items():
        if key.startswith(prefix) and key.count("/") == prefix.count("/") + 1:
            by_corruption.setdefault(key.removeprefix(prefix).rpartition("/")[0], []).append(found)
    each = [np.mean(severities, axis=0) for severities in by_corruption.values()]
    return np.asarray(np.mean(each, axis=0)) if each else None


def _trust(arrays: Mapping[str, ndarray]) -> dict[str, float]:
    """ECE and NLL as metrics; empty for runs that are older than these."""
    from sextant.evaluation.confidence import trust

    return {
        name: value
        for key in conditions_in(arrays)
        if f"confidence/{key}" in arrays
        for name, value in trust(
            key, arrays[f"confidence/{key}"], arrays[f"nll/{key}"], arrays[key] == arrays["labels"]
        ).items()
    }


def _over_severities(wrong: Mapping[str, Bool[ndarray, "images"]], shared: SharedSet, name: str) -> Images:
    return np.asarray(np.mean([wrong[key] for key in shared.of(name)], axis=0))
