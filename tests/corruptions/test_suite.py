import numpy as np
import pytest
import torch

from sextant.corruptions import Condition, ContrastPoisson, CorruptionSuite, GaussianNoise
from sextant.errors import ArgumentError, UserError

IMAGES, INDICES = torch.rand(4, 1, 8, 8), torch.arange(4)


def a_suite(seed=0):
    return CorruptionSuite(
        {"gaussian": GaussianNoise([0.01, 0.5]), "contrast_poisson": ContrastPoisson([0.5, 0.25])}, seed=seed
    )


def test_clean_comes_first_then_every_corruption_at_each_severity_in_order():
    keys = [condition.key for condition in a_suite().conditions()]
    assert keys == ["clean", "gaussian/0.01", "gaussian/0.5", "contrast_poisson/0.5", "contrast_poisson/0.25"]


def test_a_suite_without_corruptions_tests_clean_images_alone():
    assert CorruptionSuite().conditions() == [Condition()]


def test_clean_images_are_not_touched():
    assert a_suite().corrupt(IMAGES, INDICES, Condition()) is IMAGES


def test_every_other_condition_applies_its_corruption_at_its_level_with_the_suites_seed():
    suite = a_suite(seed=7)
    for condition in suite.conditions()[1:]:
        direct = suite.corruptions[condition.corruption](IMAGES, condition.level, INDICES, 7)
        assert torch.equal(suite.corrupt(IMAGES, INDICES, condition), direct)


def test_suites_of_one_seed_show_the_same_images_whatever_was_drawn_before():
    condition = Condition("gaussian", 0.5)
    first = a_suite().corrupt(IMAGES, INDICES, condition)
    torch.rand(10)
    assert torch.equal(a_suite().corrupt(IMAGES, INDICES, condition), first)
    assert not torch.equal(a_suite(seed=1).corrupt(IMAGES, INDICES, condition), first)


BYTES = np.full((3, 8, 8, 1), 128, np.uint8)
CONDITION = Condition("gaussian", 0.5)


@pytest.mark.parametrize("condition", [Condition(), CONDITION])
@pytest.mark.parametrize("images", [BYTES / 255, BYTES.astype(int), BYTES[0], torch.from_numpy(BYTES), BYTES.tolist()])
def test_what_is_no_batch_of_bytes_is_refused(images, condition):
    with pytest.raises(ArgumentError, match=r"images are .* not a NumPy array of uint8 \(n, h, w, c\)"):
        a_suite().corrupt_bytes(images, np.arange(3), condition)


@pytest.mark.parametrize("indices", [np.arange(2), np.arange(4), [0, 1], np.arange(3.0), np.arange(-1, 2)])
def test_bytes_need_one_index_each(indices):
    with pytest.raises(UserError, match="indices"):
        a_suite().corrupt_bytes(BYTES, indices, CONDITION)


def test_indices_of_bytes_may_be_a_list_or_run_backwards():
    suite, indices = a_suite(), np.arange(3)[::-1]
    assert np.array_equal(
        suite.corrupt_bytes(BYTES, indices, CONDITION), suite.corrupt_bytes(BYTES, [2, 1, 0], CONDITION)
    )


def test_a_corruption_or_level_that_is_not_there_is_refused():
    for suite, known in ((a_suite(), "gaussian, contrast_poisson"), (CorruptionSuite(), "none")):
        with pytest.raises(ArgumentError, match=f"(?s)corruption=fog is not in the suite.*There are: {known}"):
            suite.corrupt(IMAGES, INDICES, Condition("fog", 3))
    with pytest.raises(ValueError, match="a level of gaussian is a finite number, not None"):
        a_suite().corrupt(IMAGES, INDICES, Condition("gaussian"))
