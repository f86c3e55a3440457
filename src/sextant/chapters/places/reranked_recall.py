"""Recall of the network's matches after re-ranking, beside that without, in one test."""

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from sextant.chapters.places.data import PlaceImages
from sextant.chapters.places.report import NETWORK, QueryReport, RerankedRecall, logged_name
from sextant.reporter import Advance
from sextant.retrieval.flat_index import FlatIndex

if TYPE_CHECKING:
    from sextant.correspondence import LocalFeatureExtractor, LocalFeatures

#: images of the map whose features are kept in memory
KEPT = 4096


def rerank_reports(
    reports: Sequence[QueryReport],
    places: PlaceImages,
    extractor: "LocalFeatureExtractor",
    candidates: int,
    progress: Advance = lambda done, total: None,
) -> RerankedRecall:
    """Re-rank the network's best matches by the images of the test, at the size that the network takes.

    Args:
        reports: one per condition of the queries.
        places: the images.
        extractor: the local features.
        candidates: number of best matches that are re-ranked.
        progress: called with the number of queries done and the total.

    Raises:
        UserError: the features need a package that is not installed.
    """
    from sextant.correspondence.reranking import count_inliers, reranked

    sizes: list[int] = []

    def features_of(row: int) -> "LocalFeatures":
        image = places.images[row]
        (found,) = extractor.detect([np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image])
        sizes.append(found.nbytes)
        return found

    of_map = lru_cache(KEPT)(features_of)
    reference = places.rows_of(places.conditions[0])
    total, done, replaced = sum(len(report.positives) for report in reports), 0, 0
    hits: dict[str, ndarray] = {}
    for report in reports:
        queries = places.rows_of(report.protocol.query)
        described = report.methods[NETWORK].described
        near = FlatIndex(described.reference).search(described.query, min(candidates, len(reference))).indices
        best = near[:, :1].copy()
        for i, row in enumerate(queries.tolist()):
            compared = [of_map(int(reference[image])) for image in near[i]]
            counted = count_inliers(
                features_of(row), compared, side=extractor.side or max(places.images.shape[1:3]), match=extractor.match
            )
            best[i] = near[i, reranked(counted)[0]]
            done += 1
            progress(done, total)
        replaced += int((best != near[:, :1]).sum())
        hits[report.protocol.query] = report.positives.hits(best)[:, 0]
    named = {report.protocol.name("R@1_reranked"): hits[report.protocol.query] for report in reports}
    return RerankedRecall(
        hits,
        {f"{name}/{NETWORK}": found for name, found in named.items()},
        {logged_name(name): float(found.mean()) for name, found in named.items() if len(found)},
        {
            "local": extractor.model,
            "candidates": candidates,
            "replaced": replaced,
            "bytes_per_image": round(float(np.mean(sizes))) if sizes else 0,
        },
    )
