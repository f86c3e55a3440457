import torch

from sextant.corruptions import Condition, ContrastPoisson, CorruptionSuite, GaussianNoise

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
