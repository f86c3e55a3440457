"""The trained descriptor compared with all others on the test split: metrics, arrays, table, figures."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray

from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.data.corrupted import corrupted_name
from sextant.chapters.places.methods import Described, baselines
from sextant.chapters.places.metrics import (
    ConditionRecall,
    PrecisionRecall,
    best_match_curve,
    picture_runs,
    single_image_ceiling,
    standstill,
)
from sextant.corruptions import Condition
from sextant.evaluation.positives import Positives
from sextant.evaluation.posterior import PlacePosterior, fit_temperature, place_posterior
from sextant.evaluation.retrieval import RANKS, Recall, RetrievalProtocol, recall
from sextant.reporter import Advance
from sextant.retrieval.flat_index import FlatIndex
from sextant.retrieval.nearest import Neighbours
from sextant.retrieval.sequence_matching import match_sequences

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NETWORK = "network"
#: queries in the gallery, and matches shown for each
GALLERY_ROWS, GALLERY_MATCHES = 8, 5


@dataclass(frozen=True)
class MethodResult:
    """One method on the queries of one condition.

    Attributes:
        described: descriptors of map and queries.
        neighbours: the most similar references of every query.
        recall: at several ranks.
        curve: precision-recall curve of the best matches.
        hit: whether the best match of each query is right.
        sequence_hit: the same with sequence matching; None where the images form no drives.
    """

    described: Described
    neighbours: Neighbours
    recall: Recall
    curve: PrecisionRecall
    hit: Bool[ndarray, "m"]
    sequence_hit: Bool[ndarray, "m"] | None


@dataclass(frozen=True)
class RerankedRecall:
    """What re-ranking found.

    Attributes:
        hits: by condition of the queries, whether the best match of each is right.
        arrays, metrics: the same and their means, under the names of recall@1 with ``_reranked``.
        facts: kind of features, number of candidates, queries whose best match was replaced, bytes an image.
    """

    hits: dict[str, Bool[ndarray, "m"]]
    arrays: dict[str, ndarray]
    metrics: dict[str, float]
    facts: dict[str, Any]


@dataclass(frozen=True)
class QueryReport:
    """All methods on the queries of one condition.

    Attributes:
        protocol: the protocol of its metrics.
        positives: of each query in the map.
        flat: queries without content, such as tunnels.
        stopped: queries with the same image as the previous or next frame, as at a stop.
        ceiling: expected recall@1 of a single-image descriptor that confuses only identical images.
        methods: results by name, the network last.
        left_out: baselines that could not be fitted, with the reason.
    """

    protocol: RetrievalProtocol
    positives: Positives
    flat: Bool[ndarray, "m"]
    stopped: Bool[ndarray, "m"]
    ceiling: float
    methods: dict[str, MethodResult]
    left_out: dict[str, str]

    @property
    def moving(self) -> Bool[ndarray, "m"]:
        """Queries that can be distinguished from their neighbours: neither flat nor stopped."""
        return np.asarray(~(self.flat | self.stopped))


def protocol_of(tolerance: PlaceTolerance, query: str = "", reference: str = "") -> RetrievalProtocol:
    """The protocol of metrics at a tolerance."""
    unit = "f" if tolerance.unit == "frames" else "m"
    return RetrievalProtocol(tolerance.positive, unit, query, reference, heading_deg=tolerance.heading_deg)


def compare(
    descriptors: Mapping[str, Float32[ndarray, "n d"]],
    places: PlaceImages,
    train: PlaceImages | None,
    tolerance: PlaceTolerance,
    *,
    sequence_length: int,
    size: tuple[int, int],
    progress: Advance = lambda done, total: None,
) -> list[QueryReport]:
    """Evaluate all methods with every traverse but the first as queries, and the first as the map.

    Args:
        descriptors: of all images, by method, from networks; ``network`` is the trained one.
        places: the images.
        train: images that baselines are fitted to; None leaves baselines out.
        tolerance: within which images show the same place.
        sequence_length: images in a sequence.
        size: height and width to which images are scaled for baselines.
        progress: called with the numbers of conditions done and in all.
    """
    reports = []
    reference_condition, *queries = places.conditions
    reference = places.rows_of(reference_condition)
    for number, condition in enumerate(queries):
        query = places.rows_of(condition)
        positives = Positives.from_sparse(places.positives(query, reference, tolerance))
        found, left_out = ({}, {}) if train is None else baselines(train, places, condition, tolerance, size=size)
        ours = {name: Described(unit_norm(d[reference]), unit_norm(d[query])) for name, d in descriptors.items()}
        length = sequence_length if places.drives else None
        methods = {name: _result(each, positives, length) for name, each in (found | ours).items()}
        still = places.still[query]
        ceiling = single_image_ceiling(positives, picture_runs(still), picture_runs(places.still[reference]))
        protocol = protocol_of(tolerance, condition, reference_condition)
        flat, stopped = places.flat[query], standstill(still)
        reports.append(QueryReport(protocol, positives, flat, stopped, ceiling, methods, left_out))
        progress(number + 1, len(queries))
    return reports


def temperature(
    descriptors: Float32[ndarray, "n d"],
    places: PlaceImages,
    tolerance: PlaceTolerance,
    elsewhere: Float32[ndarray, "m d"] | None = None,
) -> float:
    """Fit the temperature of the posterior on a split, with its first traverse as the map and the others as queries.

    Args:
        descriptors: of all images of the split.
        places: the images.
        tolerance: within which images show the same place.
        elsewhere: descriptors of other places, which enlarge the map. With a map of only a few dozen places, all
            best matches may be right, and the temperature would tend to zero.
    """
    reference = places.rows_of(places.conditions[0])
    query = np.concatenate([places.rows_of(name) for name in places.conditions[1:]])
    found, unit = places.positives(query, reference, tolerance), unit_norm(descriptors)
    similarities = unit[query] @ unit[reference].T
    if elsewhere is not None:
        similarities = np.hstack([similarities, unit[query] @ unit_norm(elsewhere).T])
        found.resize((len(query), similarities.shape[1]))
    if np.ptp(similarities) == 0:  # equal similarities: the likelihood does not depend on the temperature
        return 1.0
    return fit_temperature(similarities, Positives.from_sparse(found))


def _result(described: Described, positives: Positives, length: int | None) -> MethodResult:
    ranks = tuple(k for k in RANKS if k <= len(described.reference))
    neighbours = FlatIndex(described.reference).search(described.query, max(ranks))
    sequence_hit = None
    if length is not None:
        sequences = match_sequences(described.similarities, length=length)
        sequence_hit = positives.hits(sequences.indices[:, :1])[:, 0]
    return MethodResult(
        described,
        neighbours,
        recall(neighbours.indices, positives, ranks),
        best_match_curve(neighbours.indices, neighbours.values, positives),
        positives.hits(neighbours.indices[:, :1])[:, 0],
        sequence_hit,
    )


def metrics(reports: list[QueryReport], posteriors: list[PlacePosterior] | None) -> dict[str, float]:
    """Metrics of the network under their full names, with ``R_at_1`` since MLflow does not allow @ in names.

    Args:
        reports: one per condition.
        posteriors: for the same conditions; None if no validation split gave a temperature.
    """
    found: dict[str, float] = {}
    fitted: list[PlacePosterior | None] = [None] * len(reports) if posteriors is None else [*posteriors]
    for report, posterior in zip(reports, fitted, strict=True):
        ours = report.methods[NETWORK]
        found |= ours.recall.named(report.protocol) | ours.curve.named(report.protocol)
        found |= {} if posterior is None else posterior.named(report.protocol)
        if ours.sequence_hit is not None:
            found[report.protocol.name("R@1_sequence")] = float(ours.sequence_hit.mean())
        if report.flat.any() and not report.flat.all():
            found[report.protocol.name("R@1_not_flat")] = float(ours.hit[~report.flat].mean())
        if report.moving.any() and not report.moving.all():
            found[report.protocol.name("R@1_moving")] = float(ours.hit[report.moving].mean())
    return {logged_name(name): value for name, value in found.items() if value == value}


def logged_name(metric: str) -> str:
    """The name under which a test metric is logged; MLflow allows few signs, and none of @, = and +."""
    return "test/" + re.sub(r"[^\w.\- ]", "_", metric.replace("@", "_at_"))


def ceilings(reports: list[QueryReport]) -> dict[str, float]:
    """The single-image ceilings, under the names of the metrics that they belong to."""
    return {report.protocol.name("R@1"): report.ceiling for report in reports}


def posteriors_of(reports: list[QueryReport], temperature: float) -> list[PlacePosterior]:
    """Posteriors of the network over the map, at a temperature fitted elsewhere."""
    return [
        place_posterior(report.methods[NETWORK].described.similarities, report.positives, temperature)
        for report in reports
    ]


def arrays(reports: list[QueryReport]) -> dict[str, ndarray]:
    """For every query, whether each method finds its place, ``R@1_.../<method>``, and whether it is flat or stopped."""
    kept: dict[str, ndarray] = {}
    for report in reports:
        name = report.protocol.name("R@1")
        kept |= {f"{name}/{method}": result.hit for method, result in report.methods.items()}
        sequence = report.protocol.name("R@1_sequence")
        for method, result in report.methods.items():
            if result.sequence_hit is not None:
                kept[f"{sequence}/{method}"] = result.sequence_hit
        kept |= {report.protocol.name("flat"): report.flat, report.protocol.name("stopped"): report.stopped}
    return kept


def recall_under(reports: list[QueryReport], copies: Sequence[str], under: Sequence[Condition]) -> dict[str, float]:
    """Recall@1 of the network by condition key, over the queries of all corrupted drives, and over the same, clean.

    Args:
        reports: one per condition.
        copies: conditions whose query k is under the corruption k modulo n.
        under: the n corruptions, each at a severity.
    """
    hits: dict[str, list[bool]] = {condition.key: [] for condition in (Condition(), *under)}
    originals = {corrupted_name(report.protocol.query): report for report in reports}
    for report in (report for report in reports if report.protocol.query in copies):
        for k, hit in enumerate(report.methods[NETWORK].hit):
            hits[under[k % len(under)].key].append(bool(hit))
        hits["clean"] += [bool(hit) for hit in originals[report.protocol.query].methods[NETWORK].hit]
    return {key: float(np.mean(found)) for key, found in hits.items() if found}


def table(
    reports: list[QueryReport], sequence_length: int, reranked: RerankedRecall | None = None
) -> list[dict[str, str]]:
    """A row per condition and method, in per cent; re-ranking is of the network's matches."""
    rows = []
    for report in reports:
        for method, result in report.methods.items():
            row = {
                "query": report.protocol.query,
                "method": method,
                "dim": str(result.described.reference.shape[1]),
                "R@1": percent(result.recall.over_all[1]),
                "R@1 not flat": percent(_mean(result.hit[~report.flat])),
                "R@1 moving": percent(_mean(result.hit[report.moving])),
                "R@5": percent(result.recall.over_all.get(5, float("nan"))),
                "AUC": f"{result.curve.auc:.3f}",
                "R@100P": percent(result.curve.recall_at_precision(1)),
            }
            if result.sequence_hit is not None:
                row[f"R@1 seq {sequence_length}"] = percent(float(result.sequence_hit.mean()))
            if reranked is not None and method == NETWORK:
                row["R@1 re-ranked"] = percent(float(reranked.hits[report.protocol.query].mean()))
            rows.append(row)
    return rows


def _mean(hit: Bool[ndarray, "k"]) -> float:
    return float(hit.mean()) if len(hit) else float("nan")


def percent(share: float) -> str:
    """A share formatted for a table; a dash for nan."""
    return "–" if share != share else f"{100 * share:.1f}"


def figures(reports: list[QueryReport], places: PlaceImages, pairs: ConditionRecall) -> "Iterator[tuple[str, Figure]]":
    """Yield curves, similarity matrix and gallery of each condition, and recall between all pairs of conditions."""
    from sextant.chapters.places.figures import (
        condition_confusion,
        precision_recall_curves,
        retrieval_gallery,
        similarity_matrix,
    )

    reference = places.rows_of(places.conditions[0])
    for report in reports:
        condition, ours = report.protocol.query, report.methods[NETWORK]
        title = f"{condition} in {report.protocol.reference}, {report.protocol.name('R@1')}"
        curves = {name: result.curve for name, result in report.methods.items()}
        file = condition.replace("/", "_")
        yield f"precision_recall_{file}", precision_recall_curves(curves, title)
        yield (
            f"similarity_{file}",
            similarity_matrix(
                ours.described.similarities,
                report.positives,
                ours.neighbours.indices[:, 0],
                query=condition,
                reference=report.protocol.reference,
                title=title,
            ),
        )
        rows = _gallery_rows(report, places, places.rows_of(condition), reference)
        yield f"gallery_{file}", retrieval_gallery(rows, title)
    yield "condition_confusion", condition_confusion(pairs)


def _gallery_rows(
    report: QueryReport, places: PlaceImages, query: Int64[ndarray, "m"], reference: Int64[ndarray, "n"]
) -> list:  # type: ignore[type-arg]
    """Queries evenly spaced along the traverse, each with its best matches and the right place."""
    from sextant.chapters.places.figures import Retrieved

    ours = report.methods[NETWORK]
    shown = np.unique(np.linspace(0, len(query) - 1, GALLERY_ROWS).round().astype(int))
    matches = ours.neighbours.indices[:, :GALLERY_MATCHES]
    right = report.positives.hits(matches)
    rows = []
    for i in shown:
        partners = report.positives[int(i)]
        truth = None if not len(partners) else places.images[reference[partners[len(partners) // 2]]]
        rows.append(
            Retrieved(
                places.images[query[i]],
                [places.images[reference[j]] for j in matches[i]],
                [bool(r) for r in right[i]],
                title=places.names[query[i]],
                titles=[f"{value:.2f}" for value in ours.neighbours.values[i, :GALLERY_MATCHES]],
                truth=truth,
            )
        )
    return rows
