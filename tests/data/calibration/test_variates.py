"""Cut distributions against SciPy's, and what is refused."""

import numpy as np
import pytest
from scipy import stats

from sextant.chapters.calibration.data.camera_distributions import Mixture, Variate
from sextant.errors import UserError

Q = (np.arange(2000) + 0.5) / 2000


def cut(distribution, low, high):
    """Quantiles of a SciPy distribution inside an interval, by bisection of its distribution function."""
    below, up_to = distribution.cdf(low), distribution.cdf(high)
    return distribution.ppf(below + (up_to - below) * Q)


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"kind": "uniform", "low": -2, "high": 5}, stats.uniform(-2, 7).ppf(Q)),
        ({"kind": "log_uniform", "low": 0.5, "high": 3}, stats.loguniform(0.5, 3).ppf(Q)),
        ({"kind": "triangular", "low": 0, "mode": 0.3, "high": 1}, stats.triang(0.3).ppf(Q)),
        ({"kind": "triangular", "low": 0, "mode": 0, "high": 1}, stats.triang(0).ppf(Q)),
        ({"kind": "triangular", "low": 0, "mode": 1, "high": 1}, stats.triang(1).ppf(Q)),
        ({"kind": "normal", "mean": 0.1, "std": 0.3}, stats.norm(0.1, 0.3).ppf(Q)),
        (
            {"kind": "normal", "mean": 0.023, "std": 0.3, "low": -0.6, "high": 0.6},
            stats.truncnorm((-0.6 - 0.023) / 0.3, (0.6 - 0.023) / 0.3, 0.023, 0.3).ppf(Q),
        ),
        (
            {"kind": "cauchy", "location": 0, "scale": 0.1, "low": -0.75, "high": 0.75},
            cut(stats.cauchy(0, 0.1), -0.75, 0.75),
        ),
        (
            {"kind": "log_normal", "location": 14, "scale": 16, "sigma": 0.8, "high": 100},
            cut(stats.lognorm(0.8, 14, 16), -np.inf, 100),
        ),
        ({"kind": "constant", "value": 0.25}, np.full_like(Q, 0.25)),
    ],
)
def test_quantiles(entry, expected):
    assert np.allclose(Variate.of(entry).at(Q), expected, rtol=1e-9, atol=1e-12)


def test_mixture_has_its_weights():
    mixture = Mixture.of(
        [{"weight": 1, "kind": "constant", "value": 0}, {"weight": 3, "kind": "uniform", "low": 1, "high": 2}]
    )
    values = mixture.at(np.repeat(Q, 20), np.tile(Q[::100], 2000))
    assert np.mean(values == 0) == pytest.approx(0.25, abs=1e-3)
    assert values[values > 0].mean() == pytest.approx(1.5, abs=0.03)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ({"kind": "gaussian", "mean": 0, "std": 1}, "gaussian"),
        ({"kind": "normal", "mean": 0}, "std"),
        ({"kind": "normal", "mean": 0, "std": 1, "mode": 2}, "mode"),
        ({"kind": "normal", "mean": 0, "std": 0}, "std=0"),
        ({"kind": "uniform", "low": 0}, "low and high"),
        ({"kind": "uniform", "low": 2, "high": 1}, "low=2"),
        ({"kind": "log_uniform", "low": 0, "high": 1}, "above 0"),
        ({"kind": "triangular", "low": 0, "mode": 2, "high": 1}, "mode=2"),
    ],
)
def test_what_means_nothing_is_refused(entry, told):
    with pytest.raises(UserError, match=told):
        Variate.of(entry)


def test_weights_must_be_positive():
    with pytest.raises(UserError, match="weights"):
        Mixture.of([{"weight": 0, "kind": "constant", "value": 1}])
