"""Places in sets of images that nothing was learnt from: how far confidences are right, and what centring helps.

``python -m benchmarks.unseen_places [run=<run>] [figure=<file>.png] [data=<folder>]``

Without ``run=`` whitened principal components of each map alone. Sets: Gardens Point by day and by night, Essex, two
stretches of Nordland (frames 1,650 to 2,399, which ``experiment=places_nordland`` does not train on). Each is asked
twice: with its whole map, and with the first half of it, so that half of the queries have no place in it. What is
fitted for a set is fitted to the others: Gardens Point's two are left out together, and so are Nordland's.

Intervals: bootstrap over blocks of 20 queries that follow each other, 1,000 times.
"""

import csv
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from sextant.applications.places.place_map import PlaceMap
from sextant.baselines import WhitenedPCA
from sextant.baselines.descriptor import unit_norm
from sextant.cli.arguments import parse_arguments
from sextant.data.places.image_files import decode_image
from sextant.evaluation.places.match_confidence import fit_match_confidence
from sextant.evaluation.places.positives import Positives
from sextant.evaluation.places.posterior import fit_temperature
from sextant.retrieval.without_mean import CENTRINGS, Centring, centred

USAGE = "python -m benchmarks.unseen_places [run=<run>] [figure=<file>.png] [data=<folder>]"
KEYS = {"run": "of place recognition", "figure": "reliability of confidences", "data": "SEXTANT_DATA unless given"}
BLOCK, DRAWS = 20, 1000


@dataclass(frozen=True)
class PlaceSet:
    """Descriptors of one set of images, rows of norm one before they are centred, and which of them show one place."""

    name: str
    family: str
    reference: Float32[ndarray, "n d"]
    query: Float32[ndarray, "m d"]
    positives: Positives

    def similarities(self, centring: Centring = "none") -> Float32[ndarray, "m n"]:
        reference, query = centred(self.reference, self.query, centring)
        return np.asarray(query @ reference.T)


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    data = Path(given.get("data", os.environ.get("SEXTANT_DATA", "data")))
    network = PlaceMap.load(given["run"]) if "run" in given else None
    sets = [described(*each, network) for each in image_sets(data)]
    own = None if network is None else network.temperature.value
    console = Console(width=150)
    console.print(centring_table(sets))
    centring = chosen_centring(sets)
    told = calibration(sets, own)
    console.print(calibration_table(told))
    console.print(f"centring chosen with the set left out: {centring}")
    console.print(
        f"fitted to all sets: {fit_match_confidence([margins(*asked) for each in sets for asked in both(each)])}"
    )
    if "figure" in given:
        reliability_figure(told, Path(given["figure"]))


def image_sets(data: Path) -> list[tuple[str, str, list[Path], list[Path], list[list[int]]]]:
    """Name, family, files of the map and of the queries, and the map images at each query's place."""
    found = []
    for name, family, queries, references in (
        ("Gardens Point, day", "gardens_point", "day_left", "day_right"),
        ("Gardens Point, night", "gardens_point", "night_right", "day_right"),
        ("Essex", "essex3in1", "query", "reference"),
    ):
        root = data / family
        maps = sorted((root / references).iterdir())
        number = {f"{references}/{path.name}": i for i, path in enumerate(maps)}
        with (root / "ground_truth.csv").open() as file:
            rows = [(row["query"], row["references"].split()) for row in csv.DictReader(file)]
        rows = [row for row in rows if row[0].startswith(f"{queries}/") and all(each in number for each in row[1])]
        near = [[number[each] for each in row[1]] for row in rows]
        found.append((name, family, maps, [root / row[0] for row in rows], near))
    summer, winter = (sorted((data / "nordland" / season).iterdir()) for season in ("summer", "winter"))
    for name, first, end in (("Nordland, 1,650 on", 1650, 2025), ("Nordland, 2,025 on", 2025, 2400)):
        count = end - first
        near = [[j for j in (i - 1, i, i + 1) if 0 <= j < count] for i in range(count)]
        found.append((name, "nordland", summer[first:end], winter[first:end], near))
    return found


def described(
    name: str, family: str, maps: list[Path], queries: list[Path], near: list[list[int]], network: PlaceMap | None
) -> PlaceSet:
    height, width = (32, 64) if network is None else (network.size.height, network.size.width)
    reference, query = (np.stack([decode_image(path, height, width, 3) for path in paths]) for paths in (maps, queries))
    describer = WhitenedPCA(height, width).fit(reference) if network is None else network.descriptor.describer
    assert describer is not None
    rows = [unit_norm(np.asarray(describer.describe(images))) for images in (reference, query)]
    return PlaceSet(name, family, rows[0], rows[1], Positives.from_lists(near, len(maps)))


def hits(similarities: ndarray, positives: Positives) -> Bool[ndarray, "m"]:
    return positives.hits(similarities.argmax(axis=1)[:, None])[:, 0]


# -- centring ----------------------------------------------------------------------------------------------------------


def centring_table(sets: list[PlaceSet]) -> Table:
    """Recall@1 in per cent; what centring adds, with its interval."""
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


def interval(values: ndarray) -> tuple[float, float]:
    """The 95 % interval of a mean over queries that follow each other."""
    rng, blocks = np.random.default_rng(0), np.array_split(values, max(1, len(values) // BLOCK))
    drawn = rng.integers(len(blocks), size=(DRAWS, len(blocks)))
    totals, counts = np.array([block.sum() for block in blocks]), np.array([len(block) for block in blocks])
    means = totals[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


# -- confidence --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Told:
    """Confidences of the best matches of a set and whether they are right, by method, in both kinds of map."""

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
    """Before: the posterior, with the temperature of the run's validation split, or fitted to the other sets. After:
    by the margin, fitted to the other sets."""
    told = []
    for each in sets:
        others = [other for other in sets if other.family != each.family]
        model = fit_match_confidence([margins(*asked) for other in others for asked in both(other)])
        before = own or float(np.exp(np.mean([np.log(fit_temperature(*both(o)[0])) for o in others])))
        found = []
        for similarities, positives in both(each):
            margin, right = margins(similarities, positives)
            after = model.probability(margin)
            found.append({"before": (posterior(similarities, positives, before), right), "after": (after, right)})
        told.append(Told(each.name, *found))
    return told


def width(positives: Positives) -> int:
    """Map images on either side of one that show its place."""
    return max(0, round(float(np.median(positives.counts[positives.matchable])) - 1) // 2)


def margins(similarities: ndarray, positives: Positives) -> tuple[ndarray, ndarray]:
    """The margin of each best match over the next place, and whether it is right."""
    best, near = similarities.argmax(axis=1), width(positives)
    apart = np.abs(np.arange(similarities.shape[1]) - best[:, None]) > near + 1
    second = np.where(apart, similarities, -np.inf).max(axis=1)
    return similarities.max(axis=1) - second, hits(similarities, positives)


def posterior(similarities: ndarray, positives: Positives, temperature: float) -> ndarray:
    """Of the best match: the probability of its place, which is it and its neighbours."""
    scores = similarities.astype(np.float64) / temperature
    shares = np.exp(scores - scores.max(axis=1, keepdims=True))
    shares /= shares.sum(axis=1, keepdims=True)
    near, best = width(positives), similarities.argmax(axis=1)
    return np.array([row[max(0, j - near) : j + near + 1].sum() for row, j in zip(shares, best, strict=True)])


def calibration_table(told: list[Told]) -> Table:
    """Mean confidence less share right, in points, with its interval; before and after."""
    table = Table("set", "right, %", "before", "after", "half the map: right, %", "before", "after")
    for each in told:
        cells = []
        for kind in (each.whole, each.halved):
            cells.append(f"{100 * kind['before'][1].mean():.1f}")
            for method in ("before", "after"):
                sure, right = kind[method]
                low, high = interval(100 * (sure - right))
                cells.append(f"{100 * (sure - right).mean():+.1f} [{low:+.1f}, {high:+.1f}]")
        table.add_row(each.name, *cells)
    return table


def reliability_figure(told: list[Told], file: Path) -> None:
    """Share right against confidence in ten bins of as many queries, all left-out sets together."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    kinds = (("whole", "whole map"), ("halved", "half the map"))
    for axes, (kind, title) in zip(figure.subplots(1, 2), kinds, strict=True):
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for method, colour in (("before", "tab:orange"), ("after", "tab:blue")):
            pairs = [getattr(each, kind)[method] for each in told]
            sure, right = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
            bins = np.array_split(np.argsort(sure), 10)
            axes.plot([sure[b].mean() for b in bins], [right[b].mean() for b in bins], "o-", color=colour, label=method)
        axes.set(xlabel="confidence", ylabel="share right", title=title, xlim=(0, 1), ylim=(0, 1))
        axes.legend()
    figure.savefig(file, dpi=100)


if __name__ == "__main__":
    main(sys.argv[1:])
