import numpy as np
import pytest

from sextant.evaluation.corruption_errors import ALEXNET_CIFAR10_C, ALEXNET_IMAGENET_C, ALL_19, BENCHMARK_15


def test_the_published_baselines_have_their_printed_means():
    assert tuple(ALEXNET_CIFAR10_C.errors) == ALL_19
    assert np.mean([*ALEXNET_CIFAR10_C.errors.values()]) == pytest.approx(0.2908, abs=2e-4)
    assert tuple(ALEXNET_IMAGENET_C.errors) == BENCHMARK_15
