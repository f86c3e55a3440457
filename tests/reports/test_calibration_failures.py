"""Methods of calibration compared by their failures: at the border, without an answer, and by kinds of scene."""

import re

import numpy as np
import pytest

from sextant.chapters.calibration.measure import FAILURES, calibrated
from sextant.chapters.calibration.metrics.summary import failures
from sextant.errors import UserError
from sextant.kit.measure import require_answers

#: two methods and eight crops, of which three show few lines and none is dark
ARRAYS = {
    "bearing_deg/network": np.array([1.0, 9.999, 10.0, 10.001, 50.0, np.nan, np.inf, 3.0]),
    "bearing_deg/both": np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, np.nan, 11.0]),
    "kind/few lines": np.arange(8) >= 5,
    "kind/dark": np.zeros(8, bool),
}


@pytest.mark.parametrize(
    ("error", "failed"),
    [(0.0, False), (10.0, False), (np.nextafter(10.0, 11), True), (np.inf, True), (np.nan, True), (180.0, True)],
    ids=["exact", "at the border", "just above", "infinite", "no answer", "opposite"],
)
def test_what_a_failure_is(error, failed):
    assert failures(np.array([error]), {})["all"].tolist() == [failed]


@pytest.mark.parametrize(("method", "all_of_them", "few"), [("network", 50.0, 200 / 3), ("both", 25.0, 200 / 3)])
def test_an_arm_counts_the_failures_of_the_method_it_reads(method, all_of_them, few):
    found = calibrated(ARRAYS, method)
    assert found.measure is FAILURES
    shares = {kind: found.measure.of(values) for kind, values in found.by_condition.items()}
    assert shares == pytest.approx({"all": all_of_them, "few lines": few})  # of no crop there is no share


def test_a_run_without_kinds_has_the_failures_of_all():
    assert list(calibrated({"bearing_deg/network": np.ones(3)}, "network").by_condition) == ["all"]


def test_a_method_that_was_not_tested_is_named():
    said = "reads the answers of vanishing points; its runs have those of network, both"
    with pytest.raises(UserError, match=re.escape(said)):
        require_answers(ARRAYS, "vanishing points")
    require_answers(ARRAYS, "both")
