import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.data.datamodule import stratified_split

fractions, seeds = st.floats(0.01, 0.5), st.integers(0, 2**31 - 1)


@st.composite
def labels(draw):
    """Classes of two images or more, in any order; not every class number need occur."""
    sizes = draw(st.lists(st.sampled_from([0, 2, 3, 7, 30]), min_size=1, max_size=5).filter(any))
    members = np.repeat(np.arange(len(sizes)), sizes)
    return np.random.default_rng(draw(st.integers(0, 9))).permutation(members)


@given(labels(), fractions, seeds)
def test_every_image_is_in_one_split_and_both_are_in_order(labels, fraction, seed):
    train, validation = stratified_split(labels, fraction, seed)
    assert sorted([*train, *validation]) == list(range(len(labels)))
    assert np.all(np.diff(train) > 0)
    assert np.all(np.diff(validation) > 0)


@given(labels(), fractions, seeds)
def test_every_class_gives_its_share_and_at_least_one_image(labels, fraction, seed):
    _, validation = stratified_split(labels, fraction, seed)
    for label, size in zip(*np.unique(labels, return_counts=True), strict=True):
        held_out = np.sum(labels[validation] == label)
        assert held_out >= 1
        assert held_out == 1 or abs(held_out - fraction * size) <= 0.5


@given(labels(), fractions, seeds)
def test_the_choice_is_a_function_of_the_seed(labels, fraction, seed):
    first, second = (stratified_split(labels, fraction, seed) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_another_seed_is_another_choice():
    labels = np.repeat(np.arange(10), 50)
    (_, first), (_, second) = (stratified_split(labels, 0.1, seed) for seed in (0, 1))
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(("members", "fraction"), [([0, 0, 1], 0.1), ([0] * 10 + [1, 1], 0.9)])
def test_a_class_that_would_be_held_out_whole_is_named(members, fraction):
    with pytest.raises(ValueError, match="class 1 has"):
        stratified_split(np.array(members), fraction, 0)
