"""What every corruption takes, and that it refuses the rest with a message."""

import re

import numpy as np
import pytest
import torch
from corruptions.every_corruption import ALL, clips

from sextant.corruptions import Condition, CorruptionSuite, GaussianNoise, cifar10_c
from sextant.corruptions.filtering import bilinear, shifted_sum
from sextant.errors import UserError

COUNT = 8
every_corruption = pytest.mark.parametrize("corruption", ALL.values(), ids=ALL)


def images(count=COUNT):
    return torch.rand(count, 3, 12, 10, generator=torch.Generator().manual_seed(0))


def with_value(value):
    changed = images()
    changed[3, 1, 2, 4] = value
    return changed


REFUSED = {
    "fewer indices": (images(), torch.arange(5), "indices have the shape (5,) for 8 images"),
    "more indices": (images(), torch.arange(9), "indices have the shape (9,) for 8 images"),
    "one index for many images": (images(), 4, "indices have the shape () for 8 images"),
    "a column of indices": (images(), torch.arange(8)[:, None], "indices have the shape (8, 1)"),
    "indices that are no whole numbers": (images(), torch.arange(8.0), "indices hold torch.float32"),
    "a mask": (images(), [True] * 8, "indices hold torch.bool"),
    "indices from the end": (images(), list(range(-8, 0)), "indices reach down to -8"),
    "names": (images(), list("abcdefgh"), "are not whole numbers"),
    "values up to 255": (255 * images(), torch.arange(8), "which are not within [0, 1]\nDivide by 255."),
    "values from -1": (2 * images() - 1, torch.arange(8), "which are not within [0, 1]\nScale them"),
    "a value above 1": (with_value(1.001), torch.arange(8), "which are not within [0, 1]"),
    "nan": (with_value(float("nan")), torch.arange(8), "NaN or infinite"),
    "infinity": (with_value(float("inf")), torch.arange(8), "NaN or infinite"),
    "bytes": ((255 * images()).byte(), torch.arange(8), "images hold torch.uint8"),
    "counts": (images().long(), torch.arange(8), "images hold torch.int64"),
    "channels last": (images().permute(0, 2, 3, 1), torch.arange(8), "images.permute(0, 3, 1, 2)"),
    "one image": (images()[0], [0], "images[None]"),
    "one image, channels last": (images()[0].permute(1, 2, 0), [0], "images.permute(2, 0, 1)[None]"),
    "a plane": (images()[0, 0], [0], "images have the shape (12, 10)"),
    "four channels": (torch.rand(8, 4, 12, 10), torch.arange(8), "with 1 or 3 channels"),
    "no pixels": (torch.rand(8, 3, 0, 10), torch.arange(8), "An image needs pixels"),
    "an array": (images().numpy(), np.arange(8), "images are a ndarray"),
    "a list": ([images()[0]], [0], "images are a list"),
}


@every_corruption
def test_what_is_no_batch_of_images_with_their_indices_is_refused(corruption):
    for batch, indices, message in REFUSED.values():
        with pytest.raises(UserError, match=re.escape(message)):
            corruption(batch, corruption.levels[0], indices, 0)


@every_corruption
def test_what_is_no_level_is_refused(corruption):
    for level in (float("nan"), float("inf"), -1, "3", None, True, [3]):
        with pytest.raises(ValueError, match=corruption.name):
            corruption(images(), level, torch.arange(COUNT), 0)


@every_corruption
def test_what_is_no_seed_is_refused(corruption):
    for seed in (1.0, "1", None, [1]):
        with pytest.raises(UserError, match="is not a whole number"):
            corruption(images(), corruption.levels[0], torch.arange(COUNT), seed)


@every_corruption
def test_no_images_become_no_images(corruption):
    for indices in ([], torch.empty(0, dtype=torch.int64), torch.empty(0)):
        corrupted = corruption(images(0), corruption.levels[0], indices, 0)
        assert corrupted.shape == (0, 3, 12, 10)
        assert corrupted.dtype == torch.float32


@every_corruption
def test_indices_may_be_given_as_people_have_them(corruption):
    clean, level = images(2), corruption.levels[0]
    expected = corruption(clean, level, torch.tensor([4, 7]), 3)
    assert clips(corruption) is False or expected.max() <= 1
    as_int32 = torch.tensor([4, 7], dtype=torch.int32)
    for indices in ([4, 7], (4, 7), np.array([4, 7], np.uint16), as_int32, range(4, 8, 3)):
        assert torch.equal(corruption(clean, level, indices, np.int64(3)), expected)
    one = corruption(clean[:1], level, torch.tensor([4]), 3)
    for index in (4, np.int64(4), torch.tensor(4)):
        assert torch.equal(corruption(clean[:1], level, index, 3), one)


def test_a_suite_refuses_the_same():
    suite = CorruptionSuite({**cifar10_c(["fog"]), "gaussian": GaussianNoise([0.1])})
    for condition in suite.conditions()[1:]:
        with pytest.raises(UserError, match="Divide by 255"):
            suite.corrupt(255 * images(), torch.arange(COUNT), condition)
    assert suite.corrupt(images(1), 0, Condition("fog", 3)).shape == (1, 3, 12, 10)


def test_parts_that_do_not_fit_each_other_are_refused_before_machine_code_sees_them():
    blur = cifar10_c(["motion_blur"])["motion_blur"]
    drawn = blur.draw(3, torch.arange(5), (3, 12, 10), 0)
    with pytest.raises(ValueError, match="do not match"):
        blur.apply(images(), 3, drawn)
    with pytest.raises(ValueError, match="do not match"):
        shifted_sum(images(), torch.ones(3), torch.zeros(8, 2, 2, dtype=torch.int64), "nearest")
    with pytest.raises(ValueError, match="do not match"):
        bilinear(images(), torch.zeros(5, 4, 4), torch.zeros(5, 4, 4), "zero")
    with pytest.raises(ValueError, match="do not match"):
        bilinear(images(), torch.zeros(8, 4, 4), torch.zeros(8, 4, 5), "zero")


@every_corruption
def test_torchs_default_type_changes_no_value(corruption):
    batch = torch.rand(2, 1, 28, 28, generator=torch.Generator().manual_seed(0))
    expected = corruption(batch, corruption.levels[-1], [0, 1], 0)
    torch.set_default_dtype(torch.float64)
    try:
        found = corruption(batch, corruption.levels[-1], [0, 1], 0)
    finally:
        torch.set_default_dtype(torch.float32)
    assert torch.equal(found, expected)
