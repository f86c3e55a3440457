import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.battery import LIKELIHOODS, GaussianBattery, ObservationModelBattery
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import ArgumentError, UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP, blending_weights
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.local_gp import LocalGP
from sextant.localization.pose_kernel import SPATIAL, PoseKernel


class TestCachedLocalGPPassesTheBattery(GaussianBattery):
    mean_tolerance = 0.25
    nll_tolerance = 0.35
    map_is_exact = False

    def model(self):
        return CachedLocalGP(neighbours=16)


class TestCachedLocalGPWithTheMeanOverTheMapPassesTheBattery(GaussianBattery):
    mean_tolerance = 0.25
    nll_tolerance = 0.35

    def model(self):
        return CachedLocalGP(neighbours=16, map_evidence="mean")


class TestBlendedCachedLocalGPPassesTheBattery(ObservationModelBattery):
    mean_tolerance = 0.2
    nll_tolerance = 0.3
    map_is_exact = False

    def model(self):
        return CachedLocalGP(neighbours=16, blend=3)


kernels = st.builds(
    PoseKernel,
    spatial=st.sampled_from(SPATIAL),
    length=st.tuples(st.floats(0.3, 4), st.floats(0.3, 4)),
    heading_length=st.floats(0.3, 2),
    signal_variance=st.floats(0.1, 10),
    noise_variance=st.floats(1e-3, 1),
)


@pytest.mark.slow
@given(kernels, st.integers(1, 24), st.integers(0, 5), st.sampled_from(LIKELIHOODS))
def test_it_is_the_local_process_of_the_nearest_image(kernel, k, seed, likelihood):
    known, poses = smooth_map(90, dimension=12), poses_in_room(60, seed=20 + seed).view(2, 30, 3)
    images = descriptors_at(poses[:, 0], 12, seed=seed)
    cached, plain = CachedLocalGP(k).fit(known, kernel), LocalGP(k, "nearest_image").fit(known, kernel)
    ours, theirs = cached.predict(poses[0]), plain.predict(poses[0])
    torch.testing.assert_close(ours.mean, theirs.mean, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(ours.variance, theirs.variance, rtol=1e-4, atol=0)
    told = [model.observe(images, likelihood).log_likelihood(poses) for model in (cached, plain)]
    torch.testing.assert_close(told[0], told[1], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("noise_variance", [1e-2, 1e-3, 9e-4, 1e-5])
def test_little_noise_on_a_dense_map_costs_little_precision(noise_variance):
    """Neighbours 2 cm apart: condition numbers of up to 1e6."""
    kernel = PoseKernel("rbf", (1.5, 1.2), 0.9, 1.0, noise_variance)
    generator = torch.Generator().manual_seed(0)
    poses = 0.2 * torch.randn(300, 3, dtype=torch.float64, generator=generator)
    known = DescriptorMap.of(poses, descriptors_at(poses, 8, noise=noise_variance**0.5))
    asked = 0.2 * torch.randn(100, 3, dtype=torch.float64, generator=generator)
    images = descriptors_at(asked[:1], 8)
    cached, plain = CachedLocalGP(16).fit(known, kernel), LocalGP(16, "nearest_image").fit(known, kernel)
    torch.testing.assert_close(cached.predict(asked).variance, plain.predict(asked).variance, rtol=1e-3, atol=0)
    ours, theirs = (model.observe(images, Likelihood("univariate")) for model in (cached, plain))
    torch.testing.assert_close(
        ours.log_likelihood(asked[None]), theirs.log_likelihood(asked[None]), rtol=1e-3, atol=1e-3
    )


def test_with_all_images_for_neighbours_it_is_the_exact_process():
    known, poses = smooth_map(40), poses_in_room(30, seed=1)
    cached, exact = CachedLocalGP(40).fit(known, KERNEL).predict(poses), ExactGP().fit(known, KERNEL).predict(poses)
    torch.testing.assert_close(cached.mean, exact.mean, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(cached.variance, exact.variance, rtol=1e-4, atol=0)


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda likelihood: likelihood.form)
def test_over_the_map_images_are_compared_with_the_maps_images(likelihood):
    known, images = smooth_map(80), descriptors_at(poses_in_room(3, seed=2), 6)
    model = CachedLocalGP(16).fit(known, KERNEL)
    squared = (images[:, None].double() - known.descriptors).square().sum(dim=2)
    expected = likelihood.log_prob(squared, model.predict(known.poses).variance, 6)
    torch.testing.assert_close(model.observe(images, likelihood).over_map(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda likelihood: likelihood.form)
def test_over_the_map_images_are_compared_with_the_means_at_its_poses(likelihood):
    known, images = smooth_map(80), descriptors_at(poses_in_room(3, seed=2), 6)
    model = CachedLocalGP(16, map_evidence="mean").fit(known, KERNEL)
    told = model.observe(images, likelihood)
    at_poses = told.log_likelihood(known.poses.expand(3, -1, -1))
    torch.testing.assert_close(told.over_map(), at_poses, rtol=1e-4, atol=1e-4)


def test_one_model_serves_several_likelihoods_in_turn():
    model, images = CachedLocalGP().fit(smooth_map(80), KERNEL), descriptors_at(poses_in_room(1, seed=2), 6)
    told = [model.observe(images, likelihood).over_map() for likelihood in (*LIKELIHOODS, LIKELIHOODS[0])]
    assert torch.equal(told[0], told[-1])
    assert not torch.equal(told[0], told[1])


def _largest_change(model, images, steps: int) -> float:
    """Of the log-likelihood in one step of a straight walk through the room."""
    along = torch.linspace(0, 1, steps + 1, dtype=torch.float64)[:, None]
    walk = torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64) + along * torch.tensor([1.6, 1.2, 1.0])
    told = model.observe(images, Likelihood("univariate")).log_likelihood(walk[None])[0]
    return float(told.diff().abs().max())


def test_a_blend_is_continuous_where_another_image_becomes_the_nearest():
    """Steps ten times as short change it a tenth as much; a jump stays what it is."""
    known, images = smooth_map(), descriptors_at(poses_in_room(1, seed=3), 6)
    plain, blended = (CachedLocalGP(8, blend=m).fit(known, KERNEL) for m in (1, 3))
    assert _largest_change(plain, images, 20_000) > 0.9 * _largest_change(plain, images, 2000)
    assert _largest_change(blended, images, 20_000) < 0.15 * _largest_change(blended, images, 2000)


def test_a_blend_is_the_geometric_mean_of_the_nearest_images_likelihoods():
    known, pose = smooth_map(60), poses_in_room(1, seed=4)
    images, likelihood = descriptors_at(pose, 6), Likelihood(tempering=0.5)
    model = CachedLocalGP(8, blend=2).fit(known, KERNEL)
    near = model.neighbourhoods.of_poses(pose, 3)
    falling = torch.exp(-near.squared[0])
    shares = (falling[:2] - falling[2]) / (falling[:2] - falling[2]).sum()
    densities = []
    for row in near.rows[0, :2]:
        members = model.neighbourhoods.of_images(row[None], 8).rows[0]
        only = DescriptorMap(known.poses[members], known.descriptors[members], known.mean)
        densities.append(ExactGP().fit(only, KERNEL).observe(images, likelihood).log_likelihood(pose[None])[0, 0])
    told = model.observe(images, likelihood).log_likelihood(pose[None])[0, 0]
    torch.testing.assert_close(told, shares @ torch.stack(densities), rtol=1e-4, atol=1e-4)


@given(st.lists(st.floats(0, 1e4), min_size=2, max_size=9), st.integers(1, 8))
def test_shares_of_a_blend_sum_to_one_and_nearer_images_have_more(squared, m):
    near = torch.tensor(sorted(squared), dtype=torch.float64)[None, : m + 1]
    m = min(m, near.shape[1])
    shares = blending_weights(near, m)
    assert shares.shape == (1, m)
    assert (shares >= 0).all()
    assert (shares.diff() <= 1e-12).all()
    torch.testing.assert_close(shares.sum(), torch.tensor(1.0, dtype=torch.float64))


def test_a_blend_predicts_the_gaussian_that_is_proportional_to_the_product():
    known, pose = smooth_map(60), poses_in_room(1, seed=4)
    model = CachedLocalGP(8, blend=2).fit(known, KERNEL)
    predicted, images = model.predict(pose), torch.randn(50, 6, generator=torch.Generator().manual_seed(0))
    product = model.observe(images, Likelihood()).log_likelihood(pose.expand(50, 1, 3))[:, 0]
    squared = (images.double() - predicted.mean).square().sum(dim=1)
    gaussian = Likelihood().log_prob(squared, predicted.variance.expand(50), 6)
    torch.testing.assert_close(product - product[0], gaussian - gaussian[0], rtol=1e-4, atol=1e-3)


def test_a_blend_of_a_whole_map_works():
    known = smooth_map(20)
    told = CachedLocalGP(4, blend=20).fit(known, KERNEL).observe(descriptors_at(known.poses[:1], 6), Likelihood())
    assert told.log_likelihood(poses_in_room(5)[None]).isfinite().all()


def test_blocks_of_any_size_give_the_same_caches(monkeypatch):
    whole = CachedLocalGP().fit(smooth_map(), KERNEL).state()
    monkeypatch.setattr("sextant.localization.observation._caches.ENTRIES", 2000)
    for name, tensor in CachedLocalGP().fit(smooth_map(), KERNEL).state().items():
        torch.testing.assert_close(tensor, whole[name], rtol=1e-5, atol=1e-5)


def test_descriptors_may_be_a_mapped_file(tmp_path):
    known = smooth_map()
    np.save(tmp_path / "rows.npy", known.descriptors.numpy())
    rows = torch.from_numpy(np.load(tmp_path / "rows.npy", mmap_mode="c"))
    mapped = CachedLocalGP().fit(DescriptorMap.of(known.poses, rows), KERNEL)
    kept = CachedLocalGP().fit(known, KERNEL)
    assert all(torch.equal(tensor, kept.state()[name]) for name, tensor in mapped.state().items())


def test_a_railway_works_where_all_y_and_headings_are_one():
    poses = torch.zeros(100, 3, dtype=torch.float64)
    poses[:, 0] = torch.arange(100)
    known = DescriptorMap.of(poses, torch.sin(poses[:, :1] / 30 + torch.arange(4)).float())
    kernel = PoseKernel("matern32", (5.0, 1.0), 1.0, 1.0, 1e-3)
    model, truth = CachedLocalGP(8).fit(known, kernel), torch.tensor([[42.5, 0.0, 0.0]], dtype=torch.float64)
    image = torch.sin(truth[:, :1] / 30 + torch.arange(4)).float()
    assert int(model.observe(image, Likelihood()).over_map().argmax()) in (42, 43)
    assert (model.predict(truth).mean - image).abs().max() < 0.02


@pytest.mark.parametrize(("blend", "said"), [(0, "at least 1"), (241, r"\[1, 240\]")])
def test_a_blend_of_more_images_than_there_are_is_refused_with_the_key(blend, said):
    with pytest.raises(UserError, match=rf"blend={blend} must be .*{said}"):
        CachedLocalGP(blend=blend).fit(smooth_map(), KERNEL)


def test_an_argument_that_does_not_suit_the_map_is_of_the_model():
    with pytest.raises(ArgumentError, match="neighbours=241") as error:
        CachedLocalGP(241).fit(smooth_map(), KERNEL)
    assert error.value.of == "CachedLocalGP"


def test_a_state_that_points_outside_the_map_is_refused():
    model = CachedLocalGP().fit(smooth_map(), KERNEL)
    state = model.state()
    state["neighbours"] = state["neighbours"].clone().fill_(240)
    with pytest.raises(ValueError, match="neighbours"):
        CachedLocalGP().load_state(model.map, KERNEL, state)
