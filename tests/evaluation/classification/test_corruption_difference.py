import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from sextant.evaluation.corruption_difference import corruption_differences
from sextant.evaluation.paired import holm, paired_difference


def two_arms(seed, seeds=4, names=("fog", "snow", "frost")):
    rng = np.random.default_rng(seed)
    return ({name: rng.uniform(0, 1, seeds) for name in names} for _ in range(2))


@given(st.integers(0, 1000), st.integers(2, 6))
def test_the_mean_is_the_paired_difference_of_the_means(seed, seeds):
    treatment, control = two_arms(seed, seeds)
    found = corruption_differences(treatment, control)
    own, other = (np.mean(list(arm.values()), axis=0) for arm in (treatment, control))
    expected = paired_difference(own, other, better="lower")
    assert repr(found.mean) == repr(expected)  # nan for the images, of which there are none
    assert found.mean.mean == pytest.approx(np.mean([d.mean for d in found.by_corruption.values()]))


@pytest.mark.slow
@given(st.integers(0, 1000))
def test_swapping_the_arms_turns_wins_into_losses(seed):
    treatment, control = two_arms(seed)
    one, other = corruption_differences(treatment, control), corruption_differences(control, treatment)
    assert (one.wins, one.certain_wins) == (other.losses, other.certain_losses)
    assert one.wins + one.losses == 3
    assert one.p_value == pytest.approx(other.p_value)


def test_certain_are_those_whose_interval_leaves_zero_out():
    control = {"fog": np.full(3, 0.5), "snow": np.full(3, 0.5), "frost": np.full(3, 0.5)}
    treatment = {
        "snow": np.array([0.3, 0.31, 0.32]),
        "fog": np.array([0.2, 0.5, 0.7]),
        "frost": np.array([0.6, 0.61, 0.62]),
    }
    found = corruption_differences(treatment, control)
    assert list(found.by_corruption) == ["snow", "fog", "frost"]
    assert (found.wins, found.losses, found.certain_wins, found.certain_losses) == (2, 1, 1, 1)
    assert [found.by_corruption[name].wins for name in ("snow", "fog", "frost")] == [3, 1, 0]  # of the treatment


def test_under_holm_are_those_of_the_t_test_corrected_for_their_number():
    rng = np.random.default_rng(0)
    control = {name: rng.normal(0.5, 0.01, 8) for name in ("fog", "snow", "frost", "blur", "noise")}
    shifts = dict(zip(control, (-0.1, 0.1, -0.009, 0.0, 0.0), strict=True))
    treatment = {name: errors + shifts[name] + rng.normal(0, 0.01, 8) for name, errors in control.items()}
    found = corruption_differences(treatment, control)
    raw = [stats.ttest_rel(treatment[name], control[name]).pvalue for name in control]
    assert list(found.p_holm.values()) == pytest.approx(holm(raw))
    assert (found.certain_wins, found.certain_losses) == (2, 1)
    assert (found.holm_wins, found.holm_losses) == (1, 1)  # frost is certain alone, but not as one of five


def test_one_seed_has_wins_but_no_intervals():
    found = corruption_differences({"fog": np.array([0.1])}, {"fog": np.array([0.2])})
    assert (found.wins, found.certain_wins) == (1, 0)
    assert np.isnan(found.by_corruption["fog"].low)


@pytest.mark.parametrize(
    ("treatment", "control"),
    [({}, {}), ({"fog": [0.1]}, {"snow": [0.1]}), ({"fog": [0.1, 0.2]}, {"fog": [0.1]})],
)
def test_arms_that_do_not_pair_are_refused(treatment, control):
    with pytest.raises(ValueError, match="need the same"):
        corruption_differences(
            {k: np.array(v) for k, v in treatment.items()}, {k: np.array(v) for k, v in control.items()}
        )
