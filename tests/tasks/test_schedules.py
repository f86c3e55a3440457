import pytest

from sextant.training.schedules import ConstantRate, CosineDecay, StepDecay


def test_steps_fall_where_the_paper_has_them():
    schedule = StepDecay(at=(1 / 3, 2 / 3), factor=0.1)
    factors = [schedule(epoch / 90) for epoch in range(90)]
    assert [epoch for epoch in range(1, 90) if factors[epoch] < factors[epoch - 1]] == [30, 60]
    assert factors[89] == pytest.approx(0.01)


def test_a_shorter_run_keeps_the_shape():
    schedule = StepDecay(at=(0.333333, 0.666667))
    assert [schedule(epoch / 12) for epoch in (3, 4, 7, 8, 11)] == pytest.approx([1, 0.1, 0.1, 0.01, 0.01])


def test_cosine_and_constant():
    assert [CosineDecay()(p) for p in (0, 0.5, 1)] == pytest.approx([1, 0.5, 0])
    assert {ConstantRate()(p) for p in (0, 0.3, 1)} == {1.0}
