"""Intervals of metrics over seeds: shares stay within [0, 1] for any number of seeds and any values."""

import math

import numpy as np
import pytest

from sextant.evaluation import mean_interval
from sextant.reports.metric import seeds_interval

SHARES = [
    "test/accuracy/clean", "test/accuracy/svm/fog/3", "test/recall_at_1", "test/success_0.5m_10deg_10f",
    "test/tracking_5m_20deg_10f", "test/coverage_95", "test/error/clean", "test/aucpr/night", "test/chance",
    "test/R_at_1_pm1f", "test/R_at_100P_pm1f", "test/pr_auc_pm1f", "test/R_at_1_pm1f_chance",
]  # fmt: skip
OTHERS = [
    "test/tilt_deg",
    "test/focal_relative",
    "test/mce",
    "test/position_m",
    "test/place_temperature_night",
    "test/error_of_all_frames_median_0.5m_10deg_10f/night",
]


@pytest.mark.parametrize("name", SHARES)
@pytest.mark.parametrize("values", [[0.70, 0.84], [0.0, 1.0], [0.9, 0.99, 1.0], [0.0, 0.01], [0.2, 0.5, 0.8, 0.4]])
def test_a_share_stays_within_its_range(name, values):
    low, high = seeds_interval(name, np.array(values))
    assert 0 <= low <= np.mean(values) <= high <= 1


@pytest.mark.parametrize("name", OTHERS)
def test_other_metrics_get_students(name):
    values = np.array([0.4, 0.6, 0.7])
    assert seeds_interval(name, values) == mean_interval(values)


def test_beyond_the_range_a_name_is_not_believed():
    values = np.array([70.0, 84.0])  # per cent
    assert seeds_interval("test/accuracy/clean", values) == mean_interval(values)


@pytest.mark.parametrize("values", [[0.5], [1.0, 1.0]])
def test_without_spread_there_is_none(values):
    assert all(map(math.isnan, seeds_interval("test/accuracy/clean", np.array(values))))
