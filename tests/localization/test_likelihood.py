import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal, multivariate_t, norm

from sextant.localization.likelihood import FORMS, Likelihood

positive = st.floats(1e-3, 10)


def _log_prob(likelihood, squared, variance, dimension):
    values = (torch.tensor(value, dtype=torch.float64) for value in (squared, variance))
    return likelihood.log_prob(*values, dimension).item()


@given(st.integers(1, 12), positive, st.floats(0, 2), st.floats(0.5, 30), st.integers(0, 99))
def test_forms_are_the_densities_of_scipy(dimension, variance, appearance, dof, seed):
    z = np.random.default_rng(seed).normal(size=dimension)
    squared, total = float(z @ z), variance + appearance
    expected = {
        "full": multivariate_normal(np.zeros(dimension), total * np.eye(dimension)).logpdf(z),
        "univariate": norm(0, math.sqrt(total)).logpdf(math.sqrt(squared)),
        "student": multivariate_t(np.zeros(dimension), total * np.eye(dimension), df=dof).logpdf(z),
    }
    for form in FORMS:
        likelihood = Likelihood(form, appearance_variance=appearance, dof=dof)
        assert _log_prob(likelihood, squared, variance, dimension) == pytest.approx(expected[form], rel=1e-9, abs=1e-9)


@given(st.sampled_from(FORMS), st.floats(0.01, 1), st.floats(0, 50), positive)
def test_tempering_is_a_factor(form, beta, squared, variance):
    plain, tempered = (_log_prob(Likelihood(form, tempering=b), squared, variance, 8) for b in (1.0, beta))
    assert tempered == pytest.approx(beta * plain, rel=1e-12, abs=1e-12)


def test_student_tends_to_full_with_many_degrees_of_freedom():
    full, student = (_log_prob(Likelihood(form, dof=1e9), 7.0, 0.5, 16) for form in ("full", "student"))
    assert student == pytest.approx(full, abs=1e-4)


@given(st.sampled_from(FORMS), positive)
def test_it_falls_with_the_distance_and_student_the_slowest(form, variance):
    squared = torch.linspace(0, 100, 50, dtype=torch.float64)
    told = Likelihood(form).log_prob(squared, torch.tensor(variance, dtype=torch.float64), 16)
    assert told.shape == (50,)
    assert (told.diff() < 0).all()


def test_full_punishes_uncertainty_once_for_each_dimension():
    wider = [_log_prob(Likelihood(form), 0.0, 2.0, 128) - _log_prob(Likelihood(form), 0.0, 1.0, 128) for form in FORMS]
    assert wider == pytest.approx([-64 * math.log(2), -0.5 * math.log(2), -64 * math.log(2)])


def test_it_can_be_differentiated():
    squared, variance = (torch.tensor([0.5, 3.0], dtype=torch.float64, requires_grad=True) for _ in range(2))
    for form in FORMS:
        torch.autograd.gradcheck(lambda q, v, form=form: Likelihood(form).log_prob(q, v, 8), (squared, variance))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"tempering": 0.0}, "tempering=0"),
        ({"tempering": 1.1}, "tempering=1.1"),
        ({"appearance_variance": -1.0}, "appearance_variance=-1"),
        ({"appearance_variance": math.inf}, "appearance_variance=inf"),
        ({"dof": 0.0}, "dof=0"),
        ({"dof": math.nan}, "dof=nan"),
    ],
)
def test_values_out_of_range_are_refused(change, told):
    with pytest.raises(ValueError, match=told):
        Likelihood(**change)
    with pytest.raises(Exception, match="form"):
        Likelihood(form="made_up")
