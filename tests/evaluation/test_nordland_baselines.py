"""Descriptors that learn from no network, on 750 frames of Nordland that nothing was fitted to."""

import numpy as np
import pytest
from PIL import Image

from sextant.baselines import CCA, LDA, Pixels, WhitenedPCA
from sextant.chapters.places.metrics import best_match_curve
from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import recall
from sextant.retrieval.flat_index import FlatIndex
from sextant.retrieval.sequence_matching import match_sequences

TRAIN, TEST = slice(0, 1600), slice(1650, 2400)


@pytest.fixture(scope="module")
def seasons(real_data):
    """Summer (reference) and winter (query) frames."""

    def read(season):
        return np.stack([np.asarray(Image.open(file).convert("L")) for file in sorted(season.glob("*.png"))])[..., None]

    return tuple(read(real_data / "nordland" / season) for season in ("summer", "winter"))


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("descriptor", "single", "sequence"),
    [
        (Pixels(), (0.18, 0.24), (0.73, 0.82)),
        (WhitenedPCA(), (0.31, 0.37), (0.83, 0.91)),
        pytest.param(LDA(), (0.51, 0.58), (0.89, 0.95), marks=pytest.mark.slow),
        pytest.param(CCA(), (0.53, 0.60), (0.89, 0.95), marks=pytest.mark.slow),
    ],
    ids=["pixels", "whitened_pca", "lda", "cca"],
)
def test_winter_is_found_in_summer_as_often_as_measured(seasons, descriptor, single, sequence):
    summer, winter = seasons
    if hasattr(descriptor, "fit_pairs"):
        descriptor.fit_pairs(summer[TRAIN], winter[TRAIN])
    else:
        descriptor.fit(summer[TRAIN])
    reference, query = descriptor.describe(summer[TEST]), descriptor.describe_query(winter[TEST])
    frames = np.arange(len(query))
    positives = Positives.within_frames(frames, frames, 1)
    found = FlatIndex(reference).search(query)
    share = recall(found.indices, positives, (1,)).over_all[1]
    assert single[0] <= share <= single[1]
    assert best_match_curve(found.indices, found.values, positives).recall[-1] == pytest.approx(share)
    everything = FlatIndex(reference).search(query, len(reference))
    similarities = np.empty((len(query), len(reference)), np.float32)
    np.put_along_axis(similarities, everything.indices, everything.values, axis=1)
    ten = match_sequences(similarities, length=10, velocities=(1.0,)).indices
    assert sequence[0] <= recall(ten, positives, (1,)).over_all[1] <= sequence[1]
