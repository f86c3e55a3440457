import math

import pytest
import torch

from sextant.localization.constants import ASIDE, FEW
from sextant.localization.odometry_check import OdometryCheck

NOWHERE, SEEN = torch.zeros(3, dtype=torch.float64), torch.tensor([True])


def told(images, motion=NOWHERE, spacing=1.0):
    still = OdometryCheck.none(1, 32)
    for image in images:
        still = still.moved(motion[None], spacing).updated(image[None], SEEN)
    return still


def of_places(count, dimension=32, seed=0):
    return torch.randn(count, dimension, generator=torch.Generator().manual_seed(seed)) / math.sqrt(2 * dimension)


def test_images_of_different_places_contradict_odometry_that_stands_from_the_fifth_on():
    images = of_places(FEW)  # on average 1 apart
    assert told(images).contradicted(1.0)
    assert not told(images[:-1]).contradicted(1.0)
    assert not told(images).contradicted(10.0)


def test_a_robot_that_stands_may_see_noise_and_one_image_of_something_else():
    place, other = of_places(2)
    images = place + 0.1 * of_places(10, seed=1)
    assert not told(images).contradicted(1.0)
    for at in range(10):
        assert not told([*images[:at], other, *images[at + 1 :]]).contradicted(1.0)


@pytest.mark.parametrize("spacing", [0.1, 1.0, 200.0])
@pytest.mark.parametrize(
    ("motion", "said_to_stand"),
    [
        ((0.0, 0.0, 0.0), True),
        ((0.9 * 0.5 / (FEW - 1), 0.0, 0.0), True),
        ((1.1 * 0.5 / (FEW - 1), 0.0, 0.0), False),
        ((0.0, 0.0, 1.1 * ASIDE / (FEW - 1)), False),
        ((math.nan, 0.0, 0.0), False),
    ],
)
def test_only_a_robot_that_is_said_to_stand_is_contradicted(motion, said_to_stand, spacing):
    motion = torch.tensor(motion, dtype=torch.float64)
    motion[:2] *= spacing
    assert told(of_places(3 * FEW), motion, spacing).contradicted(1.0) == said_to_stand


def test_steps_to_and_fro_are_not_a_stand():
    images, still = of_places(12), OdometryCheck.none(1, 32)
    for turn, image in enumerate(images):
        moved = torch.tensor([[(-1.0) ** turn, 0.0, 0.0]], dtype=torch.float64)
        still = still.moved(moved, 1.0).updated(image[None], SEEN)
    assert not still.contradicted(1.0)


def test_of_a_map_whose_images_are_all_alike_nothing_is_said():
    assert not told(of_places(FEW)).contradicted(0.0)
    assert not told(of_places(FEW)).contradicted(math.nan)


def test_descriptors_that_are_far_too_large_say_what_they_can():
    assert told(1e30 * of_places(FEW)).contradicted(1.0)
