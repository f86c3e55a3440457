"""Recall of place matches without and with re-ranking by inliers, its cost, and the confidence of the answers.

``python -m benchmarks.reranking [run=zoo:places] [local=xfeat,trunk,aliked:<folder>] [side=320,640] [sets=<name>,...]
[every=1] [fit=true] [keep=<folder>] [data=<folder>]``

The sets are those of :mod:`benchmarks.place_sets`, whose intervals are used; the rule was developed on Gardens Point by
day. *Always* takes the candidate with the most inliers whatever the retrieval answers. CPU seconds are of one query:
its features, and its matches with 15 candidates, whose features are in memory. Run it with OMP_NUM_THREADS=1.

``fit=true`` also re-ranks in half of each map, its first images, which lacks the places of some half of the queries,
fits the confidence for each set to the sets of other families, and compares it with the share of right answers; sets of
images too small for a confidence are left out of both.
"""

import hashlib
import os
import sys
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
import torch
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from benchmarks.machine import describe_machine
from benchmarks.match_confidence_fit import fit_match_confidence
from benchmarks.place_sets import ImageSet, image_sets, interval
from sextant.chapters.places.describing import upright_size
from sextant.chapters.places.match_confidence import LEAST_SIDE, deviations
from sextant.chapters.places.photo_features import PhotoFeatures, trunk_features
from sextant.chapters.places.place_map import PlaceMap
from sextant.chapters.places.reranked_matches import evidence_of
from sextant.console.arguments import parse_arguments
from sextant.correspondence import AlikedFeatures, LocalFeatureExtractor, XFeatures
from sextant.correspondence.reranking import count_inliers, reranked
from sextant.evaluation.positives import Positives

USAGE = (
    "python -m benchmarks.reranking [run=zoo:places] [local=xfeat,trunk,aliked:<folder>] [side=320,640] "
    "[sets=<name>,...] [every=1] [fit=true] [keep=<folder>] [data=<folder>]"
)
KEYS = {
    "run": "a run of place recognition (default: zoo:places)",
    "local": "kinds of local features: xfeat, trunk, aliked:<folder of its weights> (default: xfeat,trunk)",
    "side": "longer sides to which images are scaled for their local features (default: 320,640)",
    "sets": "beginnings of the names of sets, separated by commas (default: all)",
    "every": "take one of so many queries (default: 1)",
    "fit": "true: also fit confidences, and judge them on the sets left out",
    "keep": "folder in which inliers are kept, so that an interrupted measurement goes on",
    "data": "SEXTANT_DATA by default",
}
CANDIDATES = 15


class Counted(NamedTuple):
    """The candidates of each query in the order of the retrieval, with their cost.

    Attributes:
        queries: numbers of the queries.
        order, similarities, inliers: of the candidates.
        margin: of the retrieval's best match.
        positives: of all queries of the set, in this map.
        per_query: CPU seconds of a query.
        per_photo: CPU seconds and bytes of a map photo; nan where all were in memory.
    """

    queries: ndarray
    order: ndarray
    similarities: ndarray
    inliers: ndarray
    margin: ndarray
    positives: Positives
    per_query: float
    per_photo: tuple[float, float]

    @property
    def right(self) -> ndarray:
        """Which candidates show the place of their query."""
        hits = [np.isin(row, self.positives[int(i)]) for i, row in zip(self.queries, self.order, strict=True)]
        return np.array(hits)


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    torch.set_num_threads(1)
    places = PlaceMap.load(given.get("run", "zoo:places"))
    begins = tuple(given["sets"].split(",")) if "sets" in given else ("",)
    data = Path(given.get("data", os.environ.get("SEXTANT_DATA", "data")))
    chosen = [each for each in image_sets(data, corridor=True) if each.name.startswith(begins)]
    every, fit = int(given.get("every", "1")), given.get("fit") == "true"
    kept = Path(given["keep"]) if "keep" in given else None
    table = Table(
        *("set", "local", "side", "queries", "R@1", "re-ranked", "gain", "won, lost", "always (lost)"),
        *(f"in {CANDIDATES}", "CPU s a query", "CPU s a map photo", "bytes a map photo"),
    )
    told, describer, size = [], places.descriptor.describer, (places.size.height, places.size.width)
    assert describer is not None
    similarities = {each.name: each.described(describer.describe, *size).similarities() for each in chosen}
    for name in given.get("local", "xfeat,trunk").split(","):
        for side in map(int, given.get("side", "320,640").split(",")):
            features = PhotoFeatures(extractor(name, side, places))
            asked: list[tuple[ImageSet, list[Counted]]] = []
            for each in chosen:
                halves, known = (False, True) if fit else (False,), dict[tuple[int, int], int]()
                maps = [
                    counted(each, similarities[each.name], features, every, half, kept, places.model, known)
                    for half in halves
                ]
                cells = row(maps[0])
                asked.append((each, maps))
                table.add_row(each.name, name, str(side), *cells)
                print(each.name, name, side, *cells, sep=" | ", file=sys.stderr)
            if fit:
                told.append(confidence_table(f"{name}, {side} pixels", asked))
    console = Console(width=220)
    console.print(table, *told)
    console.print(describe_machine())


def extractor(name: str, side: int, places: PlaceMap) -> LocalFeatureExtractor:
    """Local features at a side."""
    kind, _, folder = name.partition(":")
    if kind == "aliked":
        return AlikedFeatures(folder, side=side)
    return trunk_features(places.descriptor.describer, side=side) if kind == "trunk" else XFeatures(side=side)


def counted(
    each: ImageSet,
    similarities: ndarray,
    features: PhotoFeatures,
    every: int,
    half: bool,
    kept: Path | None,
    model: str,
    known: dict[tuple[int, int], int],
) -> Counted:
    """Candidates of each query with their inliers, in the whole map or in its first half; ``known`` collects them."""
    similarities = similarities[::every]
    queries = np.arange(0, len(each.queries), every)
    images = similarities.shape[1] // 2 if half else similarities.shape[1]
    similarities = similarities[:, :images]
    lists = [each.positives[i] for i in range(len(each.positives))]
    positives = Positives.from_lists([found[found < images] for found in lists], images)
    order = np.argsort(-similarities, axis=1, kind="stable")[:, :CANDIDATES]
    near = same_place(each.positives)
    apart = np.abs(np.arange(images) - order[:, :1]) > near
    margin = similarities.max(1) - np.where(apart, similarities, -np.inf).max(1)
    file = None
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        key = f"{each.name} {every} {half} {features.extractor.model} {model}"
        file = kept / f"{hashlib.sha256(key.encode()).hexdigest()[:16]}.npz"
    if file is not None and file.is_file():
        with np.load(file, allow_pickle=False) as stored:
            inliers, costs = stored["inliers"], stored["costs"]
    else:
        inliers, costs = _count(each, order, queries, features, known)
        if file is not None:
            np.savez(file, inliers=inliers, costs=costs)
    values = np.take_along_axis(similarities, order, 1)
    return Counted(queries, order, values, inliers, margin, positives, costs[0], (costs[1], costs[2]))


def _count(
    each: ImageSet, order: ndarray, queries: ndarray, features: PhotoFeatures, known: dict[tuple[int, int], int]
) -> tuple[ndarray, ndarray]:
    """Inliers of the candidates; CPU seconds of a query, CPU seconds and bytes of a map photo."""
    needed = [each.maps[image] for image in np.unique(order).tolist()]
    fresh = [file for file in needed if not features.has(file)]
    start = process_time()
    for file in fresh:
        features.of_file(file)
    per_photo = (process_time() - start) / len(fresh) if fresh else np.nan
    start = process_time()
    for i, candidates in zip(queries.tolist(), order.tolist(), strict=True):
        new = [image for image in candidates if (i, image) not in known]
        maps = [features.of_file(each.maps[image]) for image in new]
        query = features.of_file(each.queries[i])
        found = count_inliers(query, maps, side=features.side, match=features.extractor.match)
        known |= {(i, image): int(count) for image, count in zip(new, found, strict=True)}
    inliers = [[known[i, image] for image in row] for i, row in zip(queries.tolist(), order.tolist(), strict=True)]
    per_query = (process_time() - start) / len(queries)
    size = float(np.mean([features.of_file(file).nbytes for file in needed]))
    return np.array(inliers), np.array([per_query, per_photo, size])


def row(found: Counted) -> list[str]:
    """Recall with its interval in per cent, and numbers of queries whose first answer became right or wrong."""
    right = found.right
    before = right[:, 0]
    numbers = np.arange(len(before))
    after = right[numbers, [reranked(each)[0] for each in found.inliers]]
    always = right[numbers, found.inliers.argmax(axis=1)]
    low, high = interval(100 * (after.astype(float) - before))
    seconds, size = found.per_photo
    return [
        str(len(before)),
        *(_recall(each) for each in (before, after)),
        f"{100 * (after.mean() - before.mean()):+.1f} [{low:+.1f}, {high:+.1f}]",
        f"{(after & ~before).sum()}, {(before & ~after).sum()}",
        f"{100 * always.mean():.1f} ({(before & ~always).sum()})",
        f"{100 * right.any(axis=1).mean():.1f}",
        f"{found.per_query:.2f}",
        "–" if np.isnan(seconds) else f"{seconds:.3f}",
        f"{size:,.0f}",
    ]


def _recall(right: ndarray) -> str:
    low, high = interval(100.0 * right)
    return f"{100 * right.mean():.1f} [{low:.1f}, {high:.1f}]"


# -- confidence --------------------------------------------------------------------------------------------------------


def same_place(positives: Positives) -> int:
    """Largest distance in the order of the map of two images that may show one place."""
    spans = [np.ptp(positives[i]) for i in range(len(positives)) if len(positives[i])]
    return int(np.median(spans)) if spans else 0


class Answers(NamedTuple):
    """What is known of the best matches after re-ranking."""

    deviations: ndarray
    right: ndarray
    in_map: ndarray
    plain_margin: ndarray
    plain_right: ndarray


def answers(found: Counted, near: int) -> Answers:
    """The evidence of each query."""
    evidence, right, hits = [], [], found.right
    for i, counts in enumerate(found.inliers):
        best = int(reranked(counts)[0])
        place = np.abs(found.order[i] - found.order[i, best]) <= near
        evidence.append(evidence_of(counts, place, best))
        right.append(hits[i, best])
    in_map = np.array([len(found.positives[int(i)]) > 0 for i in found.queries])
    # a query without a rival counts as one whose rival has no inliers, as when the confidence was fitted
    inliers, rival = np.array(evidence).T
    return Answers(deviations(inliers, np.nan_to_num(rival)), np.array(right), in_map, found.margin, hits[:, 0])


def confidence_table(title: str, asked: list[tuple[ImageSet, list[Counted]]]) -> Table:
    """Confidence minus share of right answers in points, by the margin and after re-ranking, on sets left out."""
    table = Table(
        *("set", "map", "right, %", "by the margin", "right after, %", "after re-ranking"),
        *("told *not in the map* where it is not, %", "by the margin", "where it is and was found, %", "by the margin"),
        title=title,
    )
    found = [
        (each, [answers(part, same_place(each.positives)) for part in maps])
        for each, maps in asked
        if max(upright_size(each.queries[0])) >= LEAST_SIDE
    ]
    for each, maps in found:
        others = [part for other, parts in found if other.family != each.family for part in parts]
        if not others:
            continue
        model = fit_match_confidence([(part.deviations, part.right) for part in others])
        plain = fit_match_confidence([(part.plain_margin, part.plain_right) for part in others])
        for part, name in zip(maps, ("whole", "half"), strict=True):
            sure = model.probability(part.deviations)
            before = plain.probability(part.plain_margin)
            table.add_row(
                *(each.name, name, f"{100 * part.plain_right.mean():.1f}", _bias(before, part.plain_right)),
                *(f"{100 * part.right.mean():.1f}", _bias(sure, part.right)),
                *(_told(each_sure, ~part.in_map) for each_sure in (sure, before)),
                _told(sure, part.in_map & part.right),
                _told(before, part.in_map & part.plain_right),
            )
    everything = [(part.deviations, part.right) for _, parts in found for part in parts]
    if len(found) > 1:
        table.caption = f"fitted to all sets: {fit_match_confidence(everything)}"
    return table


def _bias(sure: ndarray, right: ndarray) -> str:
    low, high = interval(100 * (sure - right))
    return f"{100 * (sure - right).mean():+.1f} [{low:+.1f}, {high:+.1f}]"


def _told(sure: ndarray, among: ndarray) -> str:
    return "–" if not among.any() else f"{100 * (sure[among] < 0.5).mean():.1f}"


if __name__ == "__main__":
    main(sys.argv[1:])
