"""Neighbours found in parts are those of one index, ties among them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.retrieval import FlatIndex
from sextant.retrieval.nearest import joined_neighbours


@given(st.lists(st.integers(1, 30), min_size=1, max_size=4), st.integers(1, 12), st.integers(0, 1000))
def test_parts_put_together_answer_as_one_index_does(sizes, k, seed):
    rng = np.random.default_rng(seed)
    # few directions, so that many are equal, in one part and in several
    rows = rng.integers(-1, 2, (sum(sizes), 3)).astype(np.float32) + np.float32(0.5)
    queries = rng.normal(size=(5, 3)).astype(np.float32)
    for similarity in ("cosine", "euclidean"):
        whole = FlatIndex(rows, similarity).search(queries, min(k, len(rows)))
        parts = [FlatIndex(part, similarity) for part in np.split(rows, np.cumsum(sizes)[:-1])]
        found = [part.search(queries, min(k, len(part))) for part in parts]
        joined = joined_neighbours(found, sizes, min(k, len(rows)), similarity)
        assert np.array_equal(joined.values, whole.values)
        assert np.array_equal(joined.indices, whole.indices)


def test_what_was_not_found_cannot_be_asked_for():
    part = FlatIndex(np.eye(3, dtype=np.float32)).search(np.eye(3, dtype=np.float32), 2)
    with pytest.raises(ValueError, match="k=3, but the parts have found 2"):
        joined_neighbours([part], [3], 3)
    with pytest.raises(ValueError, match="1 parts, but 2 sizes"):
        joined_neighbours([part], [3, 3], 2)
