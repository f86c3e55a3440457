"""What is said of a test under corruptions: errors of a published set, and its pictures."""

import numpy as np
import pytest
import torch

from sextant.chapters.classification.report import (
    condition_metrics,
    corruption_metrics,
    result_figures,
    sheet_conditions,
)
from sextant.chapters.classification.result import ClassificationResult
from sextant.corruptions import BenchmarkSuite, CorruptionSuite, GaussianNoise, PerturbationSuite
from sextant.evaluation import ALEXNET_CIFAR10_C
from sextant.models import LeNet

CLASSES = tuple(str(i) for i in range(10))


def accuracies(suite, error):
    """Accuracy by condition key, ``error(name)`` under each corruption."""
    return {c.key: 1 - (0.1387 if c.corruption is None else error(c.corruption)) for c in suite.conditions()}


def test_the_baseline_scores_one():
    suite = BenchmarkSuite("cifar10_c")
    metrics = corruption_metrics(accuracies(suite, lambda name: ALEXNET_CIFAR10_C.errors[name][0]), suite)
    assert metrics["test/mce"] == pytest.approx(1)
    assert metrics["test/relative_mce"] == pytest.approx(1)
    assert metrics["test/error/corrupted"] == pytest.approx(0.2908, abs=1e-4)  # the paper's 29.08 %
    assert metrics["test/error/clean"] == pytest.approx(0.1387)


@pytest.mark.parametrize("suite", [BenchmarkSuite("cifar10_c", severities=[1, 3]), BenchmarkSuite("mnist_c")])
def test_without_all_severities_or_a_baseline_there_is_no_ratio(suite):
    metrics = corruption_metrics(accuracies(suite, lambda name: 0.5), suite)
    assert metrics == pytest.approx({"test/error/clean": 0.1387, "test/error/corrupted": 0.5})


def test_suites_of_ones_own_have_accuracies_alone():
    suite = CorruptionSuite({"gaussian": GaussianNoise([0.1])})
    assert corruption_metrics({"clean": 1.0, "gaussian/0.1": 0.5}, suite) == {}


def test_many_conditions_are_shown_at_their_middle_severity():
    assert len(sheet_conditions(BenchmarkSuite("cifar10_c"))) == 20
    assert {c.level for c in sheet_conditions(BenchmarkSuite("cifar10_c"))} == {None, 3}
    few = BenchmarkSuite("cifar10_c", names=["fog", "contrast"])
    assert len(sheet_conditions(few)) == 11


def test_a_published_set_has_a_heat_map_in_place_of_curves():
    suite = BenchmarkSuite("mnist_c", names=["stripe", "translate"])
    labels = np.arange(12) % 10
    result = ClassificationResult(labels, np.arange(12), {c.key: labels for c in suite.conditions()})
    images = torch.zeros(12, 1, 28, 28, dtype=torch.uint8)
    names = [name for name, _ in result_figures(result, suite, LeNet("A", 1, (28, 28), 10), CLASSES, images)]
    assert names == ["corruption_heatmap", "confusion_matrix", "contact_sheet", "first_kernels"]


def test_perturbations_are_judged_by_how_often_the_class_changes_along_them():
    suite = PerturbationSuite(["gaussian_noise", "rotate"])
    predictions = {c.key: np.zeros(4, np.uint8) for c in suite.conditions()}
    predictions["gaussian_noise/3"] = np.array([1, 1, 0, 0], np.uint8)  # differs from the first frame, twice of 4 x 30
    predictions["rotate/3"] = np.array([1, 0, 0, 0], np.uint8)  # there and back, twice of 4 x 30
    result = ClassificationResult(np.zeros(4, np.int64), np.arange(4), predictions)
    assert condition_metrics(result, suite) == pytest.approx(
        {
            "test/accuracy/clean": 1.0,
            "test/flip_probability/gaussian_noise": 2 / 120,
            "test/flip_probability/rotate": 2 / 120,
        }
    )


def test_the_mean_flip_probability_needs_all_ten_perturbations():
    suite = PerturbationSuite()
    same = {c.key: np.zeros(2, np.uint8) for c in suite.conditions()}
    metrics = condition_metrics(ClassificationResult(np.zeros(2, np.int64), np.arange(2), same), suite)
    assert metrics["test/flip_probability/mean"] == 0
    assert len(metrics) == 12


def test_other_suites_have_an_accuracy_of_each_condition():
    suite = CorruptionSuite({"gaussian": GaussianNoise([0.1])})
    found = {"clean": np.array([0, 1]), "gaussian/0.1": np.array([0, 0])}
    metrics = condition_metrics(ClassificationResult(np.array([0, 1]), np.arange(2), found), suite)
    assert metrics == {"test/accuracy/clean": 1.0, "test/accuracy/gaussian/0.1": 0.5}
