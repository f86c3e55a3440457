import math

import numpy as np
import pytest
from scipy.optimize import check_grad
from scipy.special import stdtr

from benchmarks.error_model_fit import PRIORS, fit_error_model, likely_right
from sextant.chapters.calibration.error_model import COVARIATES, ErrorModel

NONE = np.zeros((1, len(COVARIATES)))


def drawn(count, rng, spread=0.5, nu=3.0, weight=0.4):
    """Errors twice as large as their standard errors where the first covariate is 0, with a scale of each source."""
    sources = np.arange(count) % 40
    sigma, z = rng.uniform(0.05, 0.2, count), rng.normal(size=(count, len(COVARIATES)))
    scale = 2 * sigma * np.exp(weight * z[:, 0] + spread * rng.normal(size=40)[sources])
    return scale * rng.standard_t(nu, count), sigma, z, [str(each) for each in sources]


def test_the_numbers_that_errors_were_drawn_by_are_found():
    errors, sigma, z, sources = drawn(8000, np.random.default_rng(0))
    found = fit_error_model(errors, sigma, z, sources)
    assert found.offset == pytest.approx(math.log(2), abs=0.3)
    assert found.slope == pytest.approx(1, abs=0.1)
    assert found.weights[0] == pytest.approx(0.4, abs=0.05)
    assert np.abs(found.weights[1:]).max() < 0.05
    assert found.nu == pytest.approx(3, rel=0.25)
    assert found.spread == pytest.approx(0.5, rel=0.4)


def test_errors_of_new_sources_are_as_often_within_a_limit_as_is_said():
    model = fit_error_model(*drawn(4000, np.random.default_rng(1)))
    errors, sigma, z, _ = drawn(4000, np.random.default_rng(2))
    said = model.within(0.2, sigma, z)
    for low in (0.2, 0.5, 0.8):
        own = (said >= low) & (said < low + 0.2)
        assert np.mean(np.abs(errors[own]) <= 0.2) == pytest.approx(said[own].mean(), abs=0.08)


def test_the_slopes_are_those_of_the_cost(monkeypatch):
    import scipy.optimize

    costs = []
    monkeypatch.setattr(
        scipy.optimize, "minimize", lambda cost, start, **_: costs.append(cost) or type("Found", (), {"x": start})
    )
    errors, sigma, z, sources = drawn(60, np.random.default_rng(3))
    fit_error_model(errors, sigma, z, sources)
    at = PRIORS[:, 0] + 0.1
    assert check_grad(lambda x: costs[0](x)[0], lambda x: costs[0](x)[1], at) < 1e-3


def test_unknown_errors_do_not_count_and_none_at_all_is_refused():
    errors, sigma, z, sources = drawn(200, np.random.default_rng(4))
    without = fit_error_model(errors[:100], sigma[:100], z[:100], sources[:100])
    errors[100:] = np.nan
    assert fit_error_model(errors, sigma, z, sources) == without
    with pytest.raises(ValueError, match="no error is known"):
        fit_error_model(errors[100:], sigma[100:], z[100:], sources[100:])


def test_without_a_spread_it_is_students_t_and_without_a_width_nothing_is_known():
    model = ErrorModel(0.0, 1.0, (0.0,) * len(COVARIATES), 4.0, 1e-12)
    assert model.within(0.3, np.array([0.1]), NONE)[0] == pytest.approx(2 * stdtr(4, 3) - 1)
    assert model.within(0.3, np.array([np.inf, np.nan]), np.repeat(NONE, 2, axis=0)).tolist() == [0, 0]
    assert ErrorModel.of_row(model.row()) == model


def test_a_threshold_that_no_answers_support_is_infinite():
    grid = np.linspace(0, 1, 11)
    assert likely_right(np.full(10, 0.9), np.zeros(10, bool), 0.02, grid) == math.inf  # ten right ones prove little
    assert likely_right(np.full(100, 0.9), np.zeros(100, bool), 0.02, grid) == 0
