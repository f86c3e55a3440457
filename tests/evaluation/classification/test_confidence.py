"""ECE against bins counted one by one, NLL against torch, at the edges of both."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st

from sextant.evaluation.confidence import BINS, Confidence, expected_calibration_error, trust


def by_hand(confidence, right, bins):
    total = 0.0
    for m in range(1, bins + 1):
        inside = (confidence > (m - 1) / bins) & (confidence <= m / bins) | ((m == 1) & (confidence == 0))
        if inside.any():
            total += inside.sum() / len(right) * abs(right[inside].mean() - confidence[inside].mean())
    return total


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=60), st.integers(1, 20))
def test_the_error_is_that_of_bins_counted_one_by_one(drawn, bins):
    confidence, right = np.array([c for c, _ in drawn]), np.array([r for _, r in drawn])
    assert expected_calibration_error(confidence, right, bins) == pytest.approx(
        by_hand(confidence, right, bins), abs=1e-9
    )


@pytest.mark.parametrize("edge", [0.0, 1 / BINS, 7 / BINS, 1.0], ids=["zero", "first edge", "inner edge", "one"])
@pytest.mark.parametrize("right", [True, False])
def test_edges_of_bins(edge, right):
    found = expected_calibration_error(np.full(4, edge), np.full(4, right))
    assert found == pytest.approx(abs(edge - right))


def test_a_calibrated_network_has_next_to_none():
    rng = np.random.default_rng(0)
    confidence = rng.uniform(0.1, 1.0, 200_000)
    assert expected_calibration_error(confidence, rng.random(200_000) < confidence) < 0.005


@pytest.mark.parametrize(
    ("confidence", "right", "bins"),
    [
        ([], [], 15),
        ([0.5], [True, False], 15),
        ([0.5], [True], 0),
        ([1.2], [True], 15),
        ([-0.1], [True], 15),
        ([np.nan], [True], 15),
    ],
    ids=["none", "lengths", "no bin", "above one", "below zero", "nan"],
)
def test_what_is_no_confidence_is_refused(confidence, right, bins):
    with pytest.raises(ValueError, match=r"need one confidence|in \[0, 1\]"):
        expected_calibration_error(np.array(confidence), np.array(right, bool), bins)


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e4], ids=["flat", "usual", "saturated"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_the_likelihood_is_that_of_cross_entropy(scale, dtype):
    logits = (torch.randn(50, 7, generator=torch.Generator().manual_seed(1)) * scale).to(dtype)
    labels = torch.arange(50) % 7
    found = Confidence.of_logits(logits, labels)
    assert found.nll.mean() == pytest.approx(F.cross_entropy(logits.float(), labels).item(), rel=1e-5)
    np.testing.assert_allclose(found.predicted, logits.float().softmax(1).amax(1), rtol=1e-5)
    assert set(trust("fog/3", found.predicted, found.nll, np.ones(50, bool))) == {"test/ece/fog/3", "test/nll/fog/3"}


def test_nothing_is_told_of_a_network_that_has_burst():
    found = Confidence.of_logits(torch.tensor([[float("nan"), 0.0]]), torch.tensor([0]))
    assert trust("clean", found.predicted, found.nll, np.array([False])) == {}


def test_batches_join_in_order():
    parts = [Confidence(np.array([0.1, 0.2]), np.array([1.0, 2.0])), Confidence(np.array([0.3]), np.array([3.0]))]
    joined = Confidence.joined(parts)
    assert (joined.predicted.tolist(), joined.nll.tolist()) == ([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
