import numpy as np
import pytest
import torch
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import _rounded_rows
from sextant.localization.observation._rounded_rows import RoundedRows
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.kernel_mixture import KernelMixture


@pytest.mark.parametrize("vectors", [1, 3])
def test_products_are_off_by_no_more_than_the_bound(monkeypatch, vectors):
    monkeypatch.setattr(_rounded_rows, "BLOCK", 7)  # several blocks, the last of them short
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((60, 33)).astype(np.float32) * np.float32(10) ** rng.uniform(-8, 8, (60, 1))
    rows = np.concatenate([rows.astype(np.float32), np.zeros((1, 33), np.float32)])  # and one of zeros
    asked = rng.standard_normal((vectors, 33)).astype(np.float32)
    off = np.abs(RoundedRows.of(rows).products(asked) - asked @ rows.T)
    scale = np.abs(rows).max(1) / 127
    assert (off <= scale / 2 * np.abs(asked).sum(1)[:, None] * 1.001).all()
    assert (off > 0).mean() > 0.9  # it did round


@pytest.mark.parametrize("runs", [1, 2])
@pytest.mark.parametrize("make", [CachedLocalGP, KernelMixture])
def test_a_rounded_map_tells_nearly_the_same(make, runs):
    known, poses = smooth_map(200, dimension=64), poses_in_room(60, seed=3).view(2, 30, 3)[:runs]
    images = descriptors_at(poses[:, 0], 64, seed=1)
    whole, rounded = (make(8, rounded=each).fit(known, KERNEL) for each in (False, True))
    told, near = (model.observe(images, Likelihood()) for model in (whole, rounded))
    for ours, theirs in (
        (near.over_map(), told.over_map()),
        (near.log_likelihood(poses), told.log_likelihood(poses)),
    ):
        assert 0 < float((ours - theirs).std()) < 0.01 * float(theirs.std())
    torch.testing.assert_close(rounded.predict(poses[0]).mean, whole.predict(poses[0]).mean)


def test_a_part_of_the_map_cannot_be_rounded():
    with pytest.raises(ValueError, match="tile=64 reads part of the map, but rounded=True holds all of it"):
        CachedLocalGP(tile=64, rounded=True)
