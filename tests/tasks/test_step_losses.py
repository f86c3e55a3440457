import pytest
import torch

from sextant.errors import LossNotFiniteError
from sextant.training.steps import StepLosses


def test_the_mean_of_every_few_steps():
    losses = StepLosses(every=3)
    returned = [losses.add(step, torch.tensor(float(step))) for step in range(7)]
    assert returned == [None, None, 1.0, None, None, 4.0, None]
    assert losses.flush() == 6.0
    assert losses.flush() is None


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_the_first_step_that_is_not_finite_is_named(bad):
    losses = StepLosses(every=10)
    losses.add(41, torch.tensor(1.0))
    losses.add(42, torch.tensor(bad))
    losses.add(43, torch.tensor(bad))
    with pytest.raises(LossNotFiniteError, match=f"became {bad} at step 42"):
        losses.flush()
