"""Points that are not Optuna's, and importances."""

import itertools

import numpy as np
from made_up_search import arguments

from sextant.config.schema.searches import dimension
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.search.study import cma_point, grid_point, importances

SPACE = {"a": dimension("uniform(-1, 3)"), "b": dimension("log_uniform(1e-4, 1e0)"), "c": dimension("int(1, 9)")}


def test_a_grid_holds_every_combination_once():
    space = {"x": dimension("choice(p, q)"), "y": dimension("int(2, 4)"), "z": dimension("choice(1, 2)")}
    points = [tuple(grid_point(space, number).values()) for number in range(12)]
    assert points == list(itertools.product(("p", "q"), (2, 3, 4), ("1", "2")))


def quality(point):
    return -((point["a"] - 1) ** 2) - (np.log10(point["b"]) + 2) ** 2 - (point["c"] - 4) ** 2 / 8


def evolved(count, seed=0):
    told = []
    for number in range(count):
        point = cma_point(SPACE, told, number, seed)
        told.append((point, quality(point) if number % 9 else -np.inf))
    return told


def test_an_evolution_stays_in_its_bounds_comes_nearer_and_is_the_same_again():
    told = evolved(105)
    for point, _ in told:
        assert all(found.low <= point[key] <= found.high for key, found in SPACE.items())
        assert isinstance(point["c"], int)
    values = [quality(point) for point, _ in told]
    assert np.mean(values[-20:]) > np.mean(values[:20]) + 1
    assert max(values[-20:]) > -0.1
    assert evolved(20) == told[:20]
    assert evolved(3, seed=1) != told[:3]


def test_the_key_that_makes_the_difference_is_the_important_one(tmp_path):
    design, _ = read_search(arguments(tmp_path))
    rates, momenta = np.geomspace(1e-4, 1e-1, 8), np.linspace(0.1, 0.99, 8)
    settings = [
        {"optimizer.lr": f"{rate:.6g}", "optimizer.momentum": f"{momentum:.6g}"}
        for rate in rates
        for momentum in momenta
    ]
    values = [float(np.log10(float(s["optimizer.lr"])) + 0.1 * float(s["optimizer.momentum"])) for s in settings]
    found = importances(settings, values, design)
    assert list(found) == ["optimizer.lr", "optimizer.momentum"]
    assert found["optimizer.lr"] > 0.9
    assert importances(settings[:3], values[:3], design) == {}
    assert importances(settings, [1.0] * len(settings), design) == {}
