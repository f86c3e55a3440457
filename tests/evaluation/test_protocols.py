import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from sextant.evaluation import SEEDS_FOR_A_CLAIM, classification_converged


@pytest.mark.parametrize(("classes", "threshold"), [(2, 0.75), (4, 0.625), (10, 0.55)])
def test_a_run_has_converged_from_halfway_between_chance_and_perfection(classes, threshold):
    assert classification_converged(threshold + 1e-9, classes)
    assert not classification_converged(threshold - 1e-9, classes)


@given(st.integers(2, 1000))
def test_guessing_has_not_converged_and_perfection_has(classes):
    assert not classification_converged(1 / classes, classes)
    assert classification_converged(1.0, classes)


def test_unanimous_seeds_suffice_for_a_claim_even_as_one_of_six():
    assert stats.binomtest(SEEDS_FOR_A_CLAIM, SEEDS_FOR_A_CLAIM).pvalue < 0.05 / 6
