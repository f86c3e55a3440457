"""Relations of images against a loop over all pairs."""

import math
from typing import NamedTuple

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.retrieval import Places, Relation, relations


class Between(NamedTuple):
    """A tolerance without a unit."""

    positive: float
    negative: float
    heading_deg: float | None = None


def wrapped(degrees):
    return abs((degrees + 180) % 360 - 180)


@st.composite
def towns(draw):
    n = draw(st.integers(0, 12))
    whole = st.integers(-6, 6).map(float)

    def column(values):
        return draw(st.lists(values, min_size=n, max_size=n))

    heading = torch.tensor(column(st.integers(-720, 720).map(float)), dtype=torch.float64)
    places = Places(
        torch.tensor([column(whole), column(whole)], dtype=torch.float64).T,
        heading if draw(st.booleans()) else None,
    )
    near = float(draw(st.integers(0, 4)))
    looks = draw(st.one_of(st.none(), st.integers(0, 180))) if places.heading is not None else None
    return places, Between(near, near + draw(st.integers(1, 4)), looks)


@given(towns())
def test_relations_are_those_of_a_loop_over_pairs(town):
    places, tolerance = town
    found = relations(places, tolerance)
    for i in range(len(places)):
        for j in range(len(places)):
            apart = math.dist(places.position[i].tolist(), places.position[j].tolist())
            turn = 0.0 if places.heading is None else wrapped(float(places.heading[i] - places.heading[j]))
            positive = i != j and apart <= tolerance.positive
            if tolerance.heading_deg is not None:
                positive = positive and turn <= tolerance.heading_deg
            assert bool(found.positive[i, j]) == positive
            assert bool(found.negative[i, j]) == (apart >= tolerance.negative)


@given(towns())
def test_relations_are_mutual_and_never_of_an_image_with_itself(town):
    places, tolerance = town
    found = relations(places, tolerance)
    for pairs in (found.positive, found.negative):
        assert torch.equal(pairs, pairs.T)
        assert not pairs.diagonal().any()


@given(towns(), st.randoms(use_true_random=False))
def test_a_part_is_a_part_of_the_whole(town, random):
    places, tolerance = town
    count = len(places)
    rows, columns = (
        torch.tensor([random.randrange(count) for _ in range(5 if count else 0)], dtype=torch.int64) for _ in range(2)
    )
    whole, part = relations(places, tolerance), relations(places, tolerance, rows, columns)
    assert torch.equal(part.positive, whole.positive[rows][:, columns])
    assert torch.equal(part.negative, whole.negative[rows][:, columns])


def test_frames_of_an_aligned_ride():
    frame = torch.tensor([0, 1, 2, 11, 12, 0])
    found = relations(Places(frame[:, None]), Between(1.0, 10.0))
    assert found.positive[0].tolist() == [False, True, False, False, False, True]
    assert found.negative[0].tolist() == [False, False, False, True, True, False]
    assert found.negative[1].tolist() == [False, False, False, True, True, False]  # from 10 frames on


def test_centimetres_are_told_apart_in_utm_coordinates():
    position = torch.tensor([[372_000.00, 4_063_000.00], [372_000.00, 4_063_000.02], [372_003.0, 4_063_004.0]]).double()
    position[1, 1] = 4_063_000.02
    assert relations(Places(position), Between(0.02 + 1e-6, 4.99)).positive[0].tolist() == [False, True, False]
    assert relations(Places(position), Between(0.01, 4.99)).positive[0].tolist() == [False] * 3
    assert relations(Places(position), Between(0.01, 4.99)).negative[0].tolist() == [False, False, True]


def test_an_anchor_is_usable_with_a_positive_and_a_negative():
    places = Places(torch.tensor([[0], [0], [100], [205], [205]]))
    assert relations(places, Between(1.0, 10.0)).usable().tolist() == [True, True, False, True, True]
    assert not relations(places, Between(1.0, 1000.0)).usable().any()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_place_that_is_not_finite_is_named(bad):
    position = torch.tensor([[0.0, 0.0], [0.0, bad]])
    with pytest.raises(ValueError, match="position of image 1"):
        Places(position)
    with pytest.raises(ValueError, match="heading of image 1"):
        Places(torch.zeros(2, 2), torch.tensor([0.0, bad]))


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="3 of heading"):
        Places(torch.zeros(2, 2), torch.zeros(3))
    with pytest.raises(ValueError, match="no heading"):
        relations(Places(torch.zeros(2, 2)), Between(5.0, 25.0, heading_deg=30))
    yes = torch.ones(2, 2, dtype=torch.bool)
    with pytest.raises(ValueError, match="at once"):
        Relation(yes, yes)
    with pytest.raises(ValueError, match="negatives"):
        Relation(yes, yes[:1])
