"""Matches re-ranked by their inliers: matches of local features that agree with one epipolar geometry."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sextant.applications.pixels import AnyImage
from sextant.chapters.places.match_confidence import LEAST_SIDE
from sextant.chapters.places.matching import NOT_COUNTED, Evidence, Matches
from sextant.chapters.places.photo_features import PhotoFeatures
from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.reporter import Advance
from sextant.retrieval import Neighbours


def rerank(
    found: Matches,
    k: int,
    candidates: int,
    queries: Sequence[AnyImage],
    files: Sequence[Path],
    features: PhotoFeatures,
    same_place: Positives,
    progress: Advance = lambda done, total: None,
) -> Matches:
    """Re-rank the best matches of each query; see :mod:`sextant.correspondence.reranking`.

    A query whose best match was replaced has no margin, which is that of the retrieval's best match.

    Args:
        found: at least ``candidates`` matches of each query, or the whole map.
        k: number of matches to keep.
        candidates: number of matches that are re-ranked.
        queries: photos of the queries.
        files: the photos of the map.
        features: detects and keeps local features.
        same_place: for each photo of the map, the photos of its place.
        progress: called with the number of queries done and the total.

    Raises:
        UserError: photos of the map are missing or cannot be read.
    """
    from sextant.correspondence.reranking import count_inliers, reranked

    near = found.neighbours.indices
    _check_files([files[image] for image in np.unique(near[:, :candidates]).tolist()], candidates, features)
    inliers, margin = np.full(near.shape, NOT_COUNTED), found.margin.copy()
    order = np.tile(np.arange(near.shape[1]), (len(near), 1))
    evidence = np.empty((len(near), 2))
    for i, query in enumerate(queries):
        compared = [features.of_file(files[image]) for image in near[i, :candidates].tolist()]
        own = features.of(query)
        counted = count_inliers(own, compared, side=features.side, match=features.extractor.match)
        inliers[i, :candidates] = counted
        order[i, :candidates] = reranked(counted)
        best = int(order[i, 0])
        place = np.isin(near[i], np.append(same_place[int(near[i, best])], near[i, best]))
        evidence[i] = evidence_of(counted, place, best)
        if max(own.width, own.height) < LEAST_SIDE:
            evidence[i, 1] = np.nan
        if best:
            margin[i] = np.nan
        progress(i + 1, len(queries))
    values, indices, inliers = (np.take_along_axis(each, order, 1)[:, :k] for each in (*found.neighbours, inliers))
    confidence = None if found.confidence is None else np.take_along_axis(found.confidence, order, 1)[:, :k]
    sequences = found.sequences
    if sequences is not None:
        sequences = type(sequences)(sequences.scores[:, :k], sequences.indices[:, :k])
    return replace(
        found,
        neighbours=Neighbours(values, indices),
        confidence=confidence,
        margin=margin,
        sequences=sequences,
        inliers=inliers,
        evidence=Evidence(evidence[:, 0], evidence[:, 1], min(candidates, near.shape[1])),
    )


def evidence_of(inliers: np.ndarray, place: np.ndarray, best: int) -> tuple[float, float]:
    """Inliers of the best match, and those of its best rival at another place; nan if all show one place.

    Args:
        inliers: of the candidates, in the order of the retrieval.
        place: whether each of at least these shows the place of the best match.
        best: number of the best match.

    >>> evidence_of(np.array([10, 50, 9]), np.array([False, True, False]), 1)
    (50.0, 10.0)
    """
    others = ~place[: len(inliers)]
    return float(inliers[best]), float(inliers[others].max()) if others.any() else math.nan


def _check_files(files: Sequence[Path], candidates: int, features: PhotoFeatures) -> None:
    """Raise a ``UserError`` if photos of the map are missing, before any features are computed."""
    missing = [file for file in files if not features.has(file) and not file.is_file()]
    if missing:
        raise UserError(
            f"rerank={candidates} reads the photos of the map; missing: {len(missing):,} of the {len(files):,} "
            f"compared, such as {missing[0]}",
            "Put the files back, add the photos again, or leave out rerank.",
        )
