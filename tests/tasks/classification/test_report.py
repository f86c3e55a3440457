"""What is said of a test under corruptions: errors of a published set, and its pictures."""

import numpy as np
import pytest
import torch

from sextant.corruptions import BenchmarkSuite, CorruptionSuite, GaussianNoise
from sextant.evaluation import ALEXNET_CIFAR10_C
from sextant.models import LeNet
from sextant.tasks.classification.report import corruption_metrics, result_figures, sheet_conditions
from sextant.tasks.classification.result import ClassificationResult

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
