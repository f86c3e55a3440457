"""The likelihood of a believed perspective field."""

import math

import pytest
import torch

from sextant.geometry.field_fit import BelievedField
from sextant.geometry.perspective_field import PerspectiveField
from sextant.losses.camera_losses import field_loss

UP = torch.tensor([0.0, -1.0]).expand(1, 500, 2)


def loss_of(off, error, seen=None):
    believed = BelievedField(PerspectiveField(off, UP), torch.full((1, 2, 500), math.log(error)), torch.ones(1, 4))
    everywhere = torch.ones(1, 500, dtype=torch.bool)
    return float(field_loss(believed, PerspectiveField(torch.zeros(1, 500), UP), everywhere if seen is None else seen))


def test_the_best_expected_error_is_the_mean_size_of_the_actual_ones():
    off = 0.1 * torch.randn(1, 500, generator=torch.Generator().manual_seed(0))
    size = float(off.abs().mean())
    best = loss_of(off, size) - math.log(size)  # up is right, where less would be better: leave its part out
    assert best < loss_of(off, 1.3 * size) - math.log(1.3 * size)
    assert best < loss_of(off, 0.7 * size) - math.log(0.7 * size)


def test_only_what_is_seen_counts():
    off, seen = torch.zeros(1, 500), torch.zeros(1, 500, dtype=torch.bool)
    off[:, 100:] = 1.0
    seen[:, :100] = True
    assert loss_of(off, 0.1, seen) == pytest.approx(loss_of(torch.zeros(1, 500), 0.1))
    assert loss_of(off, 0.1, torch.zeros_like(seen)) == 0
