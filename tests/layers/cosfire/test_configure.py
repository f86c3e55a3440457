"""What a user may get wrong about a prototype: one message each."""

import numpy as np
import pytest
import torch

from sextant.errors import UserError
from sextant.layers.cosfire import ConcentricCircles, Cosfire, GaborBank, Tuples, preset


def corner():
    image = torch.zeros(1, 41, 41)
    image[:, :21, 20:] = 1
    return image


def test_a_grey_image_may_come_with_or_without_a_batch_of_one():
    plain, batched = (preset("digit").configure(image).tuples(0) for image in (corner(), corner()[None]))
    for name in Tuples.__dataclass_fields__:
        assert torch.equal(getattr(plain, name), getattr(batched, name))


def test_without_a_point_it_is_the_middle():
    middle, told = (preset("digit").configure(corner(), point).tuples(0) for point in (None, (20, 20)))
    assert torch.equal(middle.phi, told.phi)


@pytest.mark.parametrize("point", [(-1, 5), (41, 5), (5, -0.6), (5, 40.6), (float("nan"), 5)])
def test_a_point_outside_is_refused_with_what_is_allowed(point):
    with pytest.raises(UserError, match=r"(?s)outside the prototype of 41x41.*x from 0 to 40 and y from 0 to 40"):
        preset("digit").configure(corner(), point)


@pytest.mark.parametrize("point", [(0, 0), (40, 40), (-0.5, 40.5)])
def test_a_point_on_the_border_is_inside(point):
    image = torch.from_numpy(np.random.default_rng(0).uniform(size=(1, 41, 41)))
    assert len(preset("digit").configure(image, point)) == 1


@pytest.mark.parametrize("colour", [0.0, 0.7])
def test_a_prototype_of_one_colour_is_refused(colour):
    with pytest.raises(UserError, match="a single colour"):
        preset("digit").configure(torch.full((1, 41, 41), colour))
    with pytest.raises(UserError, match="a single colour"):
        preset("digit").configure(torch.tensor([colour, 0.5, 1.0]).view(3, 1, 1).expand(3, 41, 41))


def test_a_place_without_structure_is_refused_and_leaves_no_filter():
    layer = Cosfire(GaborBank(), ConcentricCircles((0.0, 2.0)), t1=0.1)
    with pytest.raises(UserError, match=r"(?s)nothing in the prototype's neighbourhood of point=\(3,38\).*lower t1"):
        layer.configure(corner(), (3, 38))
    assert len(layer) == 0


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_prototype_that_is_not_finite_is_refused(value):
    image = corner()
    image[0, 3, 3] = value
    with pytest.raises(UserError, match="not finite"):
        preset("digit").configure(image)


def test_a_colour_prototype_is_refused_with_what_to_do():
    with pytest.raises(UserError, match=r"(?s)grey images \(b, 1, h, w\), got 3 channels.*images\.mean\(1"):
        preset("digit").configure(torch.rand(3, 41, 41, generator=torch.Generator().manual_seed(0)))


def test_several_prototypes_at_once_are_refused():
    with pytest.raises(UserError, match=r"one image, got \(2, 1, 41, 41\)"):
        preset("digit").configure(corner().expand(2, 1, 41, 41))
