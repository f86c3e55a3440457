"""Places in held-out sets of images: recall, the gain by centring, and the calibration of confidences.

``python -m benchmarks.unseen_places [run=<run>,...] [rivals=true] [figure=<file>.png] [data=<folder>]``

Each run is a network: a run of place recognition, ``zoo:places``, the file of a published network or ``onnx:<file>``;
all of them are in one table. ``rivals=true`` adds descriptors not trained on
pairs (:mod:`benchmarks.place_rivals`); without ``run=`` only these are tested. Centring and confidence are those of the
first network. The sets are those of :mod:`benchmarks.place_sets`; confidences are evaluated twice, with the whole map
and with its first half, which lacks the places of half of the queries. Parameters for a set are fitted to the others:
Gardens Point's two are left out together, and so are Nordland's.
"""

import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from benchmarks.match_confidence_fit import fit_match_confidence
from benchmarks.place_rivals import rivals
from benchmarks.place_sets import FLOORS, PlaceSet, hits, image_sets, interval
from sextant.chapters.places.place_map import PlaceMap
from sextant.console.arguments import parse_arguments
from sextant.evaluation.positives import Positives
from sextant.evaluation.posterior import fit_temperature
from sextant.kit.published_places import CARD, card_text
from sextant.retrieval.without_mean import Centring

#: means that are subtracted from queries; the first is none
CENTRINGS = get_args(Centring)
USAGE = "python -m benchmarks.unseen_places [run=<run>,...] [rivals=true] [figure=<file>.png] [data=<folder>]"
KEYS = {
    "run": "one or several runs of place recognition, files of networks or names of the zoo, separated by commas",
    "rivals": "true: also test descriptors not trained on pairs",
    "figure": "file for the reliability diagram of confidences",
    "data": "SEXTANT_DATA by default",
}


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    images = image_sets(Path(given.get("data", os.environ.get("SEXTANT_DATA", "data"))), floors=True)
    runs = given["run"].split(",") if "run" in given else []
    networks = {run: PlaceMap.load(run) for run in runs}
    for run, network in networks.items():
        if CARD in network.descriptor.facts:
            print(f"{run}: {card_text(network.descriptor.facts[CARD])}", file=sys.stderr)
    found: dict[str, list[PlaceSet]] = {run: [] for run in runs}
    measured: dict[str, list[tuple[str, ...]]] = {}
    for each in images:
        for run, network in networks.items():
            describer, size = network.descriptor.describer, network.size
            assert describer is not None
            found[run].append(each.described(describer.describe, size.height, size.width))
            measured.setdefault(run, []).append(recalls(found[run][-1]))
        if not runs or given.get("rivals") == "true":
            for name, rival in rivals(each):
                measured.setdefault(name, []).append(recalls(rival))
        for name, cells in measured.items():
            print(f"{each.name}: {name}: {cells[-1][0]}; less the running mean {cells[-1][1]}", file=sys.stderr)
    console = Console(width=200)
    for k, title in enumerate(("as they are", "less the running mean")):
        console.print(
            recall_table(title, [each.name for each in images], {n: [c[k] for c in m] for n, m in measured.items()})
        )
    if not runs:
        return
    sets = [each for each in found[runs[0]] if each.family != FLOORS]
    console.print(centring_table(sets))
    told = calibration(sets, networks[runs[0]].temperature.value)
    console.print(calibration_table(told))
    console.print(f"centring chosen with the set left out: {chosen_centring(sets)}")
    asked = [pair for each in sets for pair in both(each)]
    console.print(f"fitted to all sets: {fit_match_confidence([margins(*pair) for pair in asked])}")
    console.print(f"and the temperature of the posterior: {shared_temperature(sets):.4f}")
    if "figure" in given:
        reliability_figure(told, Path(given["figure"]))


# -- recall ------------------------------------------------------------------------------------------------------------


def recalls(each: PlaceSet) -> tuple[str, ...]:
    """Recall@1 with its interval and recall@5, in per cent; with raw descriptors, and less the running mean."""
    cells = []
    kinds: tuple[Centring, ...] = ("none", "running")
    for kind in kinds:
        similarities = each.similarities(kind)
        first, fifth = (hits(similarities, each.positives, k) for k in (1, 5))
        low, high = interval(100.0 * first)
        cells.append(f"{100 * first.mean():.1f} [{low:.1f}, {high:.1f}] / {100 * fifth.mean():.1f}")
    return tuple(cells)


def recall_table(title: str, names: Iterable[str], measured: dict[str, list[str]]) -> Table:
    """R@1 with its interval / R@5 of each method."""
    table = Table("R@1 / R@5, %", *names, title=title)
    for name, cells in measured.items():
        table.add_row(name, *cells)
    return table


# -- centring ----------------------------------------------------------------------------------------------------------


def centring_table(sets: list[PlaceSet]) -> Table:
    """Recall@1 in per cent, and the gain by centring with its interval."""
    table = Table("set", "R@1", "less the running mean", "less the mean of all queries")
    for each in sets:
        plain = hits(each.similarities(), each.positives)
        cells = [f"{100 * plain.mean():.1f}"]
        for kind in CENTRINGS[1:]:
            other = hits(each.similarities(kind), each.positives)
            low, high = interval(100.0 * (other.astype(float) - plain))
            cells.append(
                f"{100 * other.mean():.1f} ({100 * (other.mean() - plain.mean()):+.1f} [{low:+.1f}, {high:+.1f}])"
            )
        table.add_row(each.name, *cells)
    return table


def chosen_centring(sets: list[PlaceSet]) -> dict[str, str]:
    """For each family the centring that has the best mean recall on all others."""
    recalls = {kind: [hits(s.similarities(kind), s.positives).mean() for s in sets] for kind in CENTRINGS}
    chosen = {}
    for family in dict.fromkeys(each.family for each in sets):
        others = [k for k, each in enumerate(sets) if each.family != family]
        chosen[family] = max(CENTRINGS, key=lambda kind: np.mean([recalls[kind][k] for k in others]))
    return chosen


# -- confidence --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Told:
    """Confidences of the best matches of a set and their correctness, by method, in both kinds of map."""

    name: str
    whole: dict[str, tuple[ndarray, ndarray]]
    halved: dict[str, tuple[ndarray, ndarray]]


def both(each: PlaceSet) -> list[tuple[ndarray, Positives]]:
    """Similarities and positives in the whole map, and in its first half, where half of the queries have no place."""
    similarities, half = each.similarities(), len(each.reference) // 2
    lists = [each.positives[i] for i in range(len(each.positives))]
    first = Positives.from_lists([found[found < half] for found in lists], half)
    return [(similarities, each.positives), (similarities[:, :half], first)]


def calibration(sets: list[PlaceSet], own: float | None) -> list[Told]:
    """Before: the posterior at the temperature of the run's validation split (omitted if there is none); fitted: at
    that of the other sets; after: by the margin, fitted to the other sets."""
    told = []
    for each in sets:
        others = [other for other in sets if other.family != each.family]
        model = fit_match_confidence([margins(*asked) for other in others for asked in both(other)])
        temperatures = {"before": own, "fitted": shared_temperature(others)}
        found = []
        for similarities, positives in both(each):
            margin, right = margins(similarities, positives)
            told_of = {
                name: (posterior(similarities, positives, value), right)
                for name, value in temperatures.items()
                if value is not None
            }
            found.append(told_of | {"after": (model.probability(margin), right)})
        told.append(Told(each.name, *found))
    return told


def shared_temperature(sets: list[PlaceSet]) -> float:
    """The geometric mean of the temperatures fitted to each set's whole map."""
    return float(np.exp(np.mean([np.log(fit_temperature(*both(each)[0])) for each in sets])))


def width(positives: Positives) -> int:
    """Number of map images on either side of one that show its place."""
    return max(0, round(float(np.median(positives.counts[positives.matchable])) - 1) // 2)


def margins(similarities: ndarray, positives: Positives) -> tuple[ndarray, ndarray]:
    """The margin of each best match over the next place, and whether it is correct."""
    best, near = similarities.argmax(axis=1), width(positives)
    apart = np.abs(np.arange(similarities.shape[1]) - best[:, None]) > near + 1
    second = np.where(apart, similarities, -np.inf).max(axis=1)
    return similarities.max(axis=1) - second, hits(similarities, positives)


def posterior(similarities: ndarray, positives: Positives, temperature: float) -> ndarray:
    """The probability of the best match's place, i.e. of it and its neighbours."""
    scores = similarities.astype(np.float64) / temperature
    shares = np.exp(scores - scores.max(axis=1, keepdims=True))
    shares /= shares.sum(axis=1, keepdims=True)
    near, best = width(positives), similarities.argmax(axis=1)
    return np.array([row[max(0, j - near) : j + near + 1].sum() for row, j in zip(shares, best, strict=True)])


def calibration_table(told: list[Told]) -> Table:
    """Mean confidence minus accuracy, in points, with its interval; before and after."""
    methods = list(told[0].whole)
    table = Table("set", "right, %", *methods, "half the map: right, %", *methods)
    for each in told:
        cells = []
        for kind in (each.whole, each.halved):
            cells.append(f"{100 * kind['after'][1].mean():.1f}")
            for sure, right in kind.values():
                low, high = interval(100 * (sure - right))
                cells.append(f"{100 * (sure - right).mean():+.1f} [{low:+.1f}, {high:+.1f}]")
        table.add_row(each.name, *cells)
    return table


def reliability_figure(told: list[Told], file: Path) -> None:
    """Accuracy against confidence in ten bins of equally many queries, over all held-out sets."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    kinds = (("whole", "whole map"), ("halved", "half the map"))
    for axes, (kind, title) in zip(figure.subplots(1, 2), kinds, strict=True):
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for method, colour in zip(
            told[0].whole, ("tab:orange", "tab:green", "tab:blue")[-len(told[0].whole) :], strict=True
        ):
            pairs = [getattr(each, kind)[method] for each in told]
            sure, right = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
            bins = np.array_split(np.argsort(sure), 10)
            axes.plot([sure[b].mean() for b in bins], [right[b].mean() for b in bins], "o-", color=colour, label=method)
        axes.set(xlabel="confidence", ylabel="share right", title=title, xlim=(0, 1), ylim=(0, 1))
        axes.legend()
    figure.savefig(file, dpi=100)


if __name__ == "__main__":
    main(sys.argv[1:])
