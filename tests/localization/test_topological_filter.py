import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.topological_filter import TopologicalFilter, likelihood_rate

AHEAD = (1.0, 0.0, 0.0)


def line(images, spacing=1.0):
    poses = torch.zeros(images, 3, dtype=torch.float64)
    poses[:, 0] = spacing * torch.arange(images)
    return poses


def away(images, at):
    return (torch.arange(images) - at).abs().double()


def driven(filter, motions, distances, rate):
    belief = filter.uniform()
    for motion, row in zip(motions, distances, strict=True):
        belief = filter.step(belief, motion, row, rate)
    return belief


def test_it_is_the_sum_over_all_paths_of_a_small_map():
    """Every sequence of states, weighed by its transitions and likelihoods, in NumPy."""
    rng = np.random.default_rng(0)
    poses, jump, rate = rng.normal(size=(4, 3)), 0.05, 1.3
    motions, distances = 0.5 * rng.normal(size=(3, 3)), rng.uniform(0, 2, (3, 4))
    filter = TopologicalFilter(torch.from_numpy(poses), 0.7, 0.4, jump)
    matrices = []
    for dx, dy, turn in motions:
        matrix = np.zeros((4, 4))
        for i, j in itertools.product(range(4), repeat=2):
            x, y, heading = poses[i]
            ahead = np.array([x + dx * np.cos(heading) - dy * np.sin(heading),
                              y + dx * np.sin(heading) + dy * np.cos(heading)])  # fmt: skip
            squared = np.square(ahead - poses[j, :2]).sum() / 0.7**2
            squared += 2 * (1 - np.cos(heading + turn - poses[j, 2])) / 0.4**2
            matrix[i, j] = np.exp(-squared / 2)
        matrices.append(jump / 4 + (1 - jump) * matrix / matrix.sum(1, keepdims=True))
    total = np.zeros(4)
    for before, *path in itertools.product(range(4), repeat=4):
        weight, at = 0.25, before
        for matrix, seen, to in zip(matrices, distances, path, strict=True):
            weight, at = weight * matrix[at, to] * np.exp(-rate * seen[to]), to
        total[at] += weight
    found = driven(filter, motions.tolist(), torch.from_numpy(distances), rate)
    np.testing.assert_allclose(found.numpy(), total / total.sum(), rtol=1e-10)


@pytest.mark.parametrize("spacing", [1e-3, 1.0, 200.0])
def test_short_motions_add_up_whatever_the_spacing(spacing):
    """Thirty steps of a third of a spacing are ten images but for 6 %; nothing is seen."""
    filter = TopologicalFilter.of(line(60, spacing), jump=1e-9)
    belief = torch.zeros(60, dtype=torch.float64)
    belief[15] = 1.0
    for _ in range(30):
        belief = filter.moved(belief, (spacing / 3, 0.0, 0.0))
    assert float(belief @ torch.arange(60).double()) == pytest.approx(25, abs=0.65)


def test_a_robot_that_was_carried_away_is_found_again():
    filter, rate = TopologicalFilter.of(line(40)), likelihood_rate(away(40, 3), odds=50)
    truth = [*range(3, 13), *range(30, 40)]
    before = driven(filter, [AHEAD] * 10, [away(40, at) for at in truth[:10]], rate)
    after = driven(filter, [AHEAD] * 20, [away(40, at) for at in truth], rate)
    assert (int(before.argmax()), int(after.argmax())) == (12, 39)
    never = TopologicalFilter.of(line(40), jump=1e-60)
    assert int(driven(never, [AHEAD] * 20, [away(40, at) for at in truth], rate).argmax()) != 30


@given(
    st.lists(st.floats(0, 1.7e308), min_size=5, max_size=5),
    st.lists(st.floats(-1.7e308, 1.7e308), min_size=3, max_size=3),
)
def test_whatever_is_seen_the_belief_is_finite_and_sums_to_one(distances, motion):
    seen = torch.tensor(distances, dtype=torch.float64)
    filter, rate = TopologicalFilter.of(line(5)), likelihood_rate(seen)
    assert math.isfinite(rate)
    belief = filter.uniform()
    for _ in range(3):
        belief = filter.step(belief, motion, seen, rate)
        assert bool(belief.isfinite().all())
        assert float(belief.sum()) == pytest.approx(1)


def test_the_best_images_are_as_many_times_as_likely_as_the_odds_say():
    distances = torch.linspace(0.2, 1.4, 201, dtype=torch.float64)
    rate = likelihood_rate(distances, odds=7)
    assert math.exp(rate * float(distances[195] - distances[5])) == pytest.approx(7)
    assert likelihood_rate(torch.ones(9, dtype=torch.float64)) == 0
