"""Matches re-ranked by their inliers: matches of local features that agree with one epipolar geometry."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications.pixels import AnyImage, as_pixels
from sextant.chapters.places.describing import upright_size
from sextant.chapters.places.matching import NOT_COUNTED, Matches
from sextant.errors import UserError
from sextant.reporter import Advance
from sextant.retrieval import Neighbours

if TYPE_CHECKING:
    from sextant.correspondence import LocalFeatures, XFeatures

#: photos whose features are kept in memory: some 1 GiB at 2,048 keypoints, of 64 half-precision numbers each
KEPT = 4096


class PhotoFeatures:
    """Local features of photos; those of the map's files are kept in memory, the most recently used.

    Args:
        features: detects them; by default XFeat at its own settings. Larger photos are decoded at its ``side``.
    """

    def __init__(self, features: "XFeatures | None" = None):
        from sextant.correspondence import XFeatures

        self.features = XFeatures() if features is None else features
        self.of_file = lru_cache(KEPT)(self.of)

    @property
    def side(self) -> int:
        """The longer side of images, in whose pixels distances from epipolar lines are measured."""
        return self.features.side or 640

    def of(self, photo: AnyImage) -> "LocalFeatures":
        """The features of a file, bytes or a Pillow image.

        Raises:
            UserError: it cannot be read, or the features need a package that is not installed.
        """
        (found,) = self.features.detect([self._pixels(photo)])
        return found

    def _pixels(self, photo: AnyImage) -> UInt8[ndarray, "h w 3"]:
        size = None
        if isinstance(photo, Path | str) and Path(photo).is_file():
            width, height = upright_size(Path(photo))
            scale = min(1.0, self.side / max(width, height))
            size = (max(1, round(scale * height)), max(1, round(scale * width)), 3)
        pixels = as_pixels(photo, size)
        return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


def rerank(
    found: Matches,
    k: int,
    candidates: int,
    queries: Sequence[AnyImage],
    files: Sequence[Path],
    features: PhotoFeatures,
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
        progress: called with the number of queries done and the total.

    Raises:
        UserError: photos of the map are missing or cannot be read.
    """
    from sextant.correspondence.reranking import count_inliers, reranked

    near = found.neighbours.indices
    _check_files([files[image] for image in np.unique(near[:, :candidates]).tolist()], candidates)
    inliers, margin = np.full(near.shape, NOT_COUNTED), found.margin.copy()
    order = np.tile(np.arange(near.shape[1]), (len(near), 1))
    for i, query in enumerate(queries):
        compared = [features.of_file(files[image]) for image in near[i, :candidates].tolist()]
        inliers[i, :candidates] = count_inliers(features.of(query), compared, side=features.side)
        order[i, :candidates] = reranked(inliers[i, :candidates])
        if order[i, 0]:
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
    )


def _check_files(files: Sequence[Path], candidates: int) -> None:
    """Raise a ``UserError`` if photos of the map are missing, before any features are computed."""
    missing = [file for file in files if not file.is_file()]
    if missing:
        raise UserError(
            f"rerank={candidates} reads the photos of the map; missing: {len(missing):,} of the {len(files):,} "
            f"compared, such as {missing[0]}",
            "Put the files back, add the photos again, or leave out rerank.",
        )
