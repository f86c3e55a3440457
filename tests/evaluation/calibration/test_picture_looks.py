import numpy as np
import pytest
import torch

from sextant.chapters.calibration.metrics.picture_looks import NUMBERS, LooksSpread, own_distances, picture_looks


def scenes(count, views, seed=0):
    """Views of scenes: a bright sky over a dark ground, with edges; every scene has colours of its own."""
    rng = np.random.default_rng(seed)
    pictures, labels = [], []
    for scene in range(count):
        sky, ground = rng.uniform(0.6, 0.9, 3), rng.uniform(0.1, 0.4, 3)
        for _ in range(views):
            horizon = rng.integers(8, 16)
            picture = np.empty((3, 24, 32))
            picture[:, :horizon], picture[:, horizon:] = sky[:, None, None], ground[:, None, None]
            picture[:, :, rng.integers(0, 32, 4)] *= 0.7
            pictures.append(picture + rng.normal(0, 0.02, picture.shape))
            labels.append(scene)
    return torch.from_numpy(np.stack(pictures)).float().clamp(0, 1), torch.tensor(labels)


def test_pictures_of_the_same_kind_are_as_far_as_the_own_ones_and_others_farther():
    seen, labels = scenes(30, 6)
    looks = picture_looks(seen)
    own, spread = own_distances(looks, labels), LooksSpread.fit(looks)
    usual = own.quantile(0.95)
    alike = spread.distance(picture_looks(scenes(20, 6, seed=1)[0]))
    assert (alike > usual).float().mean() < 0.15
    noise = torch.rand(4, 3, 24, 32, generator=torch.Generator().manual_seed(0))
    for strange in (noise, torch.full((1, 3, 24, 32), 0.5), seen[:8].flip(2), 1 - seen[:8]):
        assert (spread.distance(picture_looks(strange)) > usual).all()


def test_the_distance_is_mahalanobis_with_a_shrunk_covariance():
    looks = torch.randn(40, NUMBERS, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    looks = looks @ torch.diag(torch.linspace(0.1, 3, NUMBERS, dtype=torch.float64))
    spread = LooksSpread.fit(looks)
    scaled = looks / looks.std(0)
    covariance = np.cov(scaled.T.numpy())
    shrunk = 0.9 * covariance + 0.1 * np.trace(covariance) / NUMBERS * np.eye(NUMBERS)
    apart = (scaled[3] - scaled.mean(0)).numpy()
    expected = np.sqrt(apart @ np.linalg.inv(shrunk) @ apart)
    assert float(spread.distance(looks[3:4])) == pytest.approx(expected, rel=1e-4)


def test_a_scene_does_not_vouch_for_itself():
    seen, labels = scenes(6, 5)
    seen[labels == 0] = torch.rand(5, 3, 24, 32, generator=torch.Generator().manual_seed(2))
    looks = picture_looks(seen)
    own = own_distances(looks, labels)
    assert own[labels == 0].min() > 3 * LooksSpread.fit(looks).distance(looks[labels == 0]).max()
    assert own_distances(looks[labels == 1], labels[labels == 1]).isinf().all()


def test_numbers_of_any_picture_are_finite():
    for picture in (torch.zeros(1, 3, 6, 3), torch.ones(1, 3, 18, 24), torch.eye(24).expand(1, 3, 24, 24)):
        assert picture_looks(picture).shape == (1, NUMBERS)
        assert picture_looks(picture).isfinite().all()
    flat = LooksSpread.fit(picture_looks(torch.full((5, 3, 12, 12), 0.3)))
    assert flat.distance(picture_looks(torch.rand(2, 3, 12, 12))).isfinite().all()


def test_one_picture_has_no_spread():
    with pytest.raises(ValueError, match="at least 2"):
        LooksSpread.fit(torch.zeros(1, NUMBERS))
