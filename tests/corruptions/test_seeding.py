from itertools import product

import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions.corruption import generators, image_seeds


def test_seeds_are_those_that_earlier_results_were_made_with():
    assert image_seeds("gaussian", 0.1, torch.tensor([0, 1]), 0) == [455431443850761395, 7785310476290592248]


def test_no_two_of_seed_corruption_level_and_index_share_a_stream():
    settings = product(["gaussian", "poisson"], [0.1, 0.01, 1.0, 11.0], [0, 1, 10, 11])
    seeds = [s for name, level, seed in settings for s in image_seeds(name, level, torch.arange(200), seed)]
    assert len(set(seeds)) == len(seeds) == 2 * 4 * 4 * 200


@given(st.lists(st.integers(0, 2**40), min_size=1, max_size=9))
def test_a_seed_depends_on_its_own_index_alone(indices):
    alone = [image_seeds("gaussian", 0.1, torch.tensor([index]), 0)[0] for index in indices]
    assert image_seeds("gaussian", 0.1, torch.tensor(indices), 0) == alone


@given(st.integers(0, 2**40), st.integers(0, 2**31))
def test_seeds_have_63_bits(index, seed):
    assert 0 <= image_seeds("gaussian", 0.1, torch.tensor([index]), seed)[0] < 2**63


def test_generators_start_at_their_seeds():
    first, second, again = (torch.rand(3, generator=generator) for generator in generators([5, 6, 5]))
    assert torch.equal(first, again)
    assert not torch.equal(first, second)
