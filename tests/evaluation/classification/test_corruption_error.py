import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import cifar10_c, imagenet_c
from sextant.evaluation.corruption_errors import (
    ALL_19,
    BENCHMARK_15,
    CORRUPTION_FAMILIES,
    CorruptionBaseline,
    CorruptionErrors,
    corruption_ratio,
    corruption_score,
    relative_corruption_ratio,
)

shares = st.floats(0.01, 0.99)
five = st.tuples(shares, shares, shares, shares, shares)


def a_baseline(clean=0.1, **errors):
    return CorruptionBaseline("AlexNet", "nowhere", clean, errors)


def test_the_sets_have_15_and_19_corruptions_once_each():
    assert (len(BENCHMARK_15), len(ALL_19), len(set(ALL_19))) == (15, 19, 19)
    assert set(ALL_19) - set(BENCHMARK_15) == set(CORRUPTION_FAMILIES["extra"])


def test_scores_of_an_example_by_hand():
    errors = CorruptionErrors(0.1, {"fog": (0.2, 0.4), "snow": (0.3, 0.5)})
    score = corruption_score(errors, a_baseline(0.2, fog=(0.4, 0.8), snow=(0.5,)))
    assert score.ce == pytest.approx({"fog": 0.6 / 1.2, "snow": 0.8 / 1.0})
    assert score.relative_ce == pytest.approx({"fog": 0.4 / 0.8, "snow": 0.6 / 0.6})
    assert score.mean_ce == pytest.approx(0.65)
    assert score.mean_relative_ce == pytest.approx(0.75)
    assert score.error == pytest.approx(0.35)


@given(shares, st.dictionaries(st.sampled_from(ALL_19), five, min_size=1))
def test_a_model_is_one_beside_itself(clean, severities):
    errors = CorruptionErrors(
        clean, {name: tuple(clean + (1 - clean) * s for s in v) for name, v in severities.items()}
    )
    score = corruption_score(errors, CorruptionBaseline("itself", "", errors.clean, errors.severities))
    assert (score.mean_ce, score.mean_relative_ce) == pytest.approx((1, 1))


@given(five, five, shares, shares)
def test_ratios_are_those_of_sums_over_severities(own, other, clean, other_clean):
    assert corruption_ratio(own, other) == pytest.approx(sum(own) / sum(other))
    if abs(sum(a - other_clean for a in other)) > 1e-3:
        expected = sum(e - clean for e in own) / sum(a - other_clean for a in other)
        assert relative_corruption_ratio(own, clean, other, other_clean) == pytest.approx(expected, abs=1e-9)


@given(five, five)
def test_the_mean_of_a_baseline_stands_for_each_of_its_severities(own, other):
    assert corruption_ratio(own, [float(np.mean(other))]) == pytest.approx(corruption_ratio(own, other))


@given(five, five, shares, shares, st.floats(0.01, 0.2))
def test_relative_errors_forgive_what_a_model_does_wrong_on_clean_images(own, other, clean, other_clean, more):
    if abs(np.mean(other) - other_clean) < 1e-3:
        return
    before = relative_corruption_ratio(own, clean, other, other_clean)
    worse = relative_corruption_ratio([e + more for e in own], clean + more, other, other_clean)
    assert worse == pytest.approx(before, abs=1e-9)


def test_a_set_is_averaged_alone():
    errors = CorruptionErrors(0.0, {"fog": (0.2,), "snow": (0.4,), "saturate": (0.9,)})
    assert errors.mean(("fog", "snow")) == pytest.approx(0.3)
    assert errors.mean() == pytest.approx(0.5)
    assert set(corruption_score(errors, a_baseline(0, fog=(0.1,), snow=(0.2,)), ("snow", "fog")).ce) == {"snow", "fog"}


def test_errors_are_sorted_into_corruptions_and_severities_by_their_condition():
    errors = CorruptionErrors.of_conditions({"fog/10": 0.4, "clean": 0.1, "fog/2": 0.2, "snow/1": 0.3})
    assert errors == CorruptionErrors(0.1, {"fog": (0.2, 0.4), "snow": (0.3,)})


@pytest.mark.parametrize(
    ("conditions", "message"),
    [({"fog/1": 0.1}, "on clean images is missing"), ({"clean": 0.1, "fog": 0.2}, "got 'fog'")],
)
def test_conditions_of_another_form_are_refused(conditions, message):
    with pytest.raises(ValueError, match=message):
        CorruptionErrors.of_conditions(conditions)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: CorruptionErrors(8.29, {"fog": (0.2,)}), "shares in .0, 1., got values from 0.2 to 8.29"),
        (lambda: CorruptionErrors(float("nan"), {"fog": (0.2,)}), "shares in"),
        (lambda: CorruptionErrors(0.1, {"fog": ()}), "without any severity: fog"),
        (lambda: CorruptionErrors(0.1, {}).mean(), "at least one corruption"),
        (lambda: CorruptionErrors(0.1, {"fog": (0.2,)}).mean(("fog", "snow")), "no error for snow"),
        (lambda: corruption_ratio([0.1, 0.2], [0.1, 0.2, 0.3]), "2 severities need as many"),
        (lambda: corruption_ratio([], [0.1]), "0 severities"),
        (lambda: corruption_ratio([0.1], [0.0]), "loss under this corruption is zero"),
        (lambda: corruption_score(CorruptionErrors(0, {"fog": (0.2,)}), a_baseline(snow=(0.1,))), "no error for fog"),
    ],
)
def test_what_cannot_be_scored_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_the_sets_of_the_metrics_are_those_that_are_made():
    assert set(BENCHMARK_15) == set(cifar10_c("benchmark15"))
    assert set(ALL_19) == set(cifar10_c()) == set(imagenet_c())
