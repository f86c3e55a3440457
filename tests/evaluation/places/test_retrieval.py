import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol, chance_recall, recall


def random_case(seed, queries=12, references=9, share=0.2):
    """A mask of positives, some rows of it empty, and rankings of all references."""
    rng = np.random.default_rng(seed)
    mask = rng.random((queries, references)) < share
    return mask, np.stack([rng.permutation(references) for _ in range(queries)])


@given(seed=st.integers(0, 999), k=st.integers(1, 9))
def test_both_conventions_are_those_of_a_loop(seed, k):
    mask, ranking = random_case(seed)
    found = [any(mask[i, j] for j in ranking[i, :k]) for i in range(len(mask))]
    result = recall(ranking, Positives.from_mask(mask), (k,))
    matchable = [i for i in range(len(mask)) if mask[i].any()]
    assert result.over_all[k] == sum(found) / len(mask)
    if matchable:
        assert result.over_matchable[k] == sum(found[i] for i in matchable) / len(matchable)
    else:
        assert np.isnan(result.over_matchable[k])
    assert (result.queries, result.unmatchable) == (len(mask), len(mask) - len(matchable))


def test_a_case_by_hand():
    positives = Positives.from_lists([[2], [], [0, 1], [3]], 4)
    neighbours = np.array([[2, 0], [1, 0], [3, 1], [0, 1]])
    result = recall(neighbours, positives, (1, 2))
    assert result.over_all == {1: 0.25, 2: 0.5}
    assert result.over_matchable == pytest.approx({1: 1 / 3, 2: 2 / 3})
    assert result.chance == pytest.approx({1: (1 / 4 + 0 + 2 / 4 + 1 / 4) / 4, 2: (1 / 2 + 0 + 5 / 6 + 1 / 2) / 4})
    assert (result.queries, result.unmatchable) == (4, 1)


def test_every_figure_is_named_with_its_protocol():
    positives = Positives.from_lists([[0], []], 2)
    result = recall(np.array([[0], [1]]), positives, (1,))
    assert result.named(RetrievalProtocol(1, "f", "winter", "summer")) == {
        "R@1_pm1f_winter_to_summer": 0.5,
        "R@1_matchable_pm1f_winter_to_summer": 1.0,
        "R@1_chance_pm1f_winter_to_summer": 0.25,
        "queries_pm1f_winter_to_summer": 2.0,
        "queries_without_positive_pm1f_winter_to_summer": 1.0,
    }
    assert RetrievalProtocol(5, "m", heading_deg=30).name("pr_auc") == "pr_auc_5m_30deg"


@pytest.mark.parametrize("arguments", [(1, "km"), (-1, "f"), (float("nan"), "m"), (1, "f", "winter")])
def test_protocols_that_say_nothing_are_refused(arguments):
    with pytest.raises(ValueError, match=r"tolerance|both traverses"):
        RetrievalProtocol(*arguments)


@pytest.mark.parametrize("k", [1, 3, 8])
def test_chance_is_what_random_rankings_recall(k):
    mask, _ = random_case(5, queries=40)
    positives, rng = Positives.from_mask(mask), np.random.default_rng(1)
    repeats = 300
    rankings = (np.stack([rng.permutation(9) for _ in mask]) for _ in range(repeats))
    shares = [recall(ranking, positives, (k,)).over_all[k] for ranking in rankings]
    error = np.std(shares) / np.sqrt(repeats)
    assert chance_recall(positives, k) == pytest.approx(np.mean(shares), abs=4 * error + 1e-9)


def test_recall_of_all_references_is_the_share_that_has_a_positive():
    mask, ranking = random_case(3)
    result = recall(ranking, Positives.from_mask(mask), (9,))
    assert result.over_all[9] == result.chance[9] == mask.any(1).mean()


def test_no_query_gives_nan_and_not_a_warning():
    result = recall(np.zeros((0, 1), np.int64), Positives.from_lists([], 3), (1,))
    assert np.isnan([result.over_all[1], result.over_matchable[1], result.chance[1]]).all()


@pytest.mark.parametrize("ranks", [(), (0,), (10,)])
def test_ranks_without_a_neighbour_are_refused(ranks):
    mask, ranking = random_case(0)
    with pytest.raises(ValueError, match=r"must be in \[1, 9\]"):
        recall(ranking, Positives.from_mask(mask), ranks)
