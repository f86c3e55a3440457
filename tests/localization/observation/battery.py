"""What every observation model must pass: subclass ``ObservationModelBattery``, give ``model`` and the bounds."""

import math

import pytest
import torch
from jaxtyping import TypeCheckError
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.model import ObservationModel
from sextant.localization.pose_kernel import PoseKernel

LIKELIHOODS = [
    Likelihood(),
    Likelihood(form="univariate", tempering=0.5),
    Likelihood(form="student", appearance_variance=0.02, dof=5.0),
]


class ObservationModelBattery:
    """Tests of a model on a smooth map of 240 images with descriptors of 6 values and unit variance."""

    #: Root mean square over poses and dimensions of the difference to the exact mean, whose own noise is 0.1.
    mean_tolerance: float
    #: By how many nats a dimension the log-likelihood of unseen images may be lower than the exact one's.
    nll_tolerance: float
    #: The log-likelihood over the map is that at the map's poses, not an approximation of it.
    map_is_exact = True
    kernel: PoseKernel = KERNEL

    def model(self) -> ObservationModel:
        """A model that is not fitted."""
        raise NotImplementedError

    @pytest.fixture(scope="class")
    @classmethod
    def fitted(cls):
        return cls().model().fit(smooth_map(), cls.kernel)

    @pytest.fixture(scope="class")
    @classmethod
    def exact(cls):
        return ExactGP().fit(smooth_map(), cls.kernel)

    def test_shapes_and_types(self, fitted):
        predicted = fitted.predict(poses_in_room(7, seed=1))
        assert predicted.mean.shape == (7, 6)
        assert predicted.mean.dtype == predicted.variance.dtype == torch.float64
        assert (predicted.variance >= self.kernel.noise_variance).all()
        assert fitted.predict(torch.zeros(0, 3, dtype=torch.float64)).mean.shape == (0, 6)

    def test_mean_is_near_that_of_the_exact_process(self, fitted, exact):
        poses = poses_in_room(300, seed=2)
        difference = fitted.predict(poses).mean - exact.predict(poses).mean
        assert difference.square().mean().sqrt() <= self.mean_tolerance

    def test_unseen_images_are_about_as_likely_as_under_the_exact_process(self, fitted, exact):
        poses = poses_in_room(300, seed=3)
        images = descriptors_at(poses, 6)
        ours, theirs = (_mean_log_density(model, poses, images) for model in (fitted, exact))
        assert math.isfinite(ours)
        assert ours >= theirs - self.nll_tolerance

    def test_a_batch_of_poses_equals_one_by_one(self, fitted):
        poses = poses_in_room(9, seed=4)
        together = fitted.predict(poses)
        for row in range(9):
            alone = fitted.predict(poses[row : row + 1])
            torch.testing.assert_close(alone.mean[0], together.mean[row], rtol=1e-9, atol=1e-9)
            torch.testing.assert_close(alone.variance[0], together.variance[row], rtol=1e-9, atol=1e-9)

    def test_predictions_do_not_change_when_a_heading_turns_full_circle(self, fitted):
        poses = poses_in_room(9, seed=5)
        turned = poses + torch.tensor([0.0, 0.0, 2 * math.pi], dtype=torch.float64)
        torch.testing.assert_close(fitted.predict(turned).mean, fitted.predict(poses).mean, rtol=1e-6, atol=1e-6)

    def test_runs_do_not_see_each_other(self, fitted):
        poses = torch.stack([poses_in_room(20, seed=9), poses_in_room(20, seed=10)])
        images = descriptors_at(poses_in_room(2, seed=11), 6)
        together = fitted.observe(images, Likelihood())
        for run in range(2):
            alone = fitted.observe(images[run : run + 1], Likelihood())
            torch.testing.assert_close(
                alone.log_likelihood(poses[run : run + 1])[0], together.log_likelihood(poses)[run], rtol=1e-5, atol=1e-4
            )
            torch.testing.assert_close(alone.over_map()[0], together.over_map()[run], rtol=1e-5, atol=1e-4)

    def test_over_map_is_the_log_likelihood_at_the_maps_poses(self, fitted):
        images = descriptors_at(poses_in_room(2, seed=12), 6)
        evidence = fitted.observe(images, Likelihood())
        over_map = evidence.over_map()
        assert over_map.shape == (2, len(fitted.map))
        if self.map_is_exact:
            expected = evidence.log_likelihood(fitted.map.poses.expand(2, -1, -1))
            torch.testing.assert_close(over_map, expected, rtol=1e-4, atol=1e-3)

    def test_an_image_of_the_map_is_most_likely_near_where_it_was_taken(self, fitted):
        rows = torch.arange(0, len(fitted.map), 12)
        over_map = fitted.observe(fitted.map.descriptors[rows], Likelihood()).over_map()
        best = fitted.map.poses[over_map.argmax(dim=1), :2]
        near = (best - fitted.map.poses[rows, :2]).norm(dim=1) < 1.0
        assert near.double().mean() >= 0.8

    def test_an_unseen_image_is_more_likely_where_it_was_taken_than_elsewhere(self, fitted):
        poses = poses_in_room(60, seed=13)
        told = fitted.observe(descriptors_at(poses, 6), Likelihood()).log_likelihood(poses.expand(60, -1, -1))
        rank = (told > told.diagonal()[:, None]).sum(dim=1)
        assert (rank <= 5).double().mean() >= 0.7

    def test_saved_and_loaded_it_predicts_the_same_bit_for_bit(self, fitted):
        assert all(tensor.is_contiguous() for tensor in fitted.state().values())
        state = {name: tensor.clone() for name, tensor in fitted.state().items()}
        again = type(fitted)(**fitted.arguments()).load_state(fitted.map, fitted.kernel, state)
        poses = poses_in_room(50, seed=14)
        images = descriptors_at(poses_in_room(1, seed=15), 6)
        assert torch.equal(again.predict(poses).mean, fitted.predict(poses).mean)
        assert torch.equal(again.predict(poses).variance, fitted.predict(poses).variance)
        ours, theirs = (model.observe(images, Likelihood()) for model in (again, fitted))
        assert torch.equal(ours.log_likelihood(poses[None]), theirs.log_likelihood(poses[None]))
        assert torch.equal(ours.over_map(), theirs.over_map())

    def test_a_descriptor_of_another_dimension_is_refused(self, fitted):
        with pytest.raises(UserError, match=r"5 values.*6"):
            fitted.observe(torch.zeros(1, 5), Likelihood())

    def test_descriptors_are_rows(self, fitted):
        with pytest.raises((UserError, TypeCheckError), match=r"descriptors has .* must have|Type-check error"):
            fitted.observe(torch.zeros(6), Likelihood())

    @pytest.mark.parametrize(("runs", "images"), [(3, 1), (1, 3), (2, 3)])
    def test_poses_of_more_or_fewer_runs_are_refused(self, fitted, runs, images):
        evidence = fitted.observe(torch.zeros(images, 6), Likelihood())
        with pytest.raises(UserError, match=rf"poses of {runs} runs? for {images} descriptors?"):
            evidence.log_likelihood(poses_in_room(4).expand(runs, -1, -1))

    def test_a_descriptor_that_is_not_a_number_tells_nothing_in_its_own_run_only(self, fitted):
        images = descriptors_at(poses_in_room(2, seed=16), 6)
        images[0] = math.nan
        told = fitted.observe(images, Likelihood()).log_likelihood(poses_in_room(10, seed=17).expand(2, -1, -1))
        assert told[0].isnan().all()
        assert told[1].isfinite().all()


def elbo(model) -> float:
    """The lower bound on the log marginal likelihood of all outputs in nats."""
    known, noise = model.map, model.kernel.noise_variance
    predicted = model.predict(known.poses)
    squared = float((known.descriptors.double() - predicted.mean).square().sum())
    left = float((predicted.variance - noise).sum())
    numbers = known.descriptors.numel()
    expected = -0.5 * (numbers * math.log(2 * math.pi * noise) + (squared + known.dimension * left) / noise)
    spread = float(model.root.square().sum()) - model.size - float(2 * model.root.diagonal().log().sum())
    return expected - 0.5 * (float(model.weights.square().sum()) + known.dimension * spread)


def log_density(known: DescriptorMap, kernel: PoseKernel) -> float:
    """The exact log marginal likelihood of all outputs in nats."""
    noisy = kernel(known.poses, known.poses) + kernel.noise_variance * torch.eye(len(known), dtype=torch.float64)
    density = torch.distributions.MultivariateNormal(torch.zeros(len(known), dtype=torch.float64), noisy)
    return float(density.log_prob((known.descriptors - known.mean).double().T).sum())


def _mean_log_density(model, poses, images) -> float:
    predicted = model.predict(poses)
    squared = (images.double() - predicted.mean).square().sum(dim=1)
    return float(Likelihood().log_prob(squared, predicted.variance, 6).mean()) / 6


class GaussianBattery(ObservationModelBattery):
    """Of models whose evidence is the likelihood of the Gaussian that they predict."""

    @pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=lambda likelihood: likelihood.form)
    def test_evidence_is_the_likelihood_of_the_prediction(self, fitted, likelihood):
        poses = torch.stack([poses_in_room(40, seed=6), poses_in_room(40, seed=7)])
        images = descriptors_at(poses_in_room(2, seed=8), 6)
        told = fitted.observe(images, likelihood).log_likelihood(poses)
        for run in range(2):
            predicted = fitted.predict(poses[run])
            squared = (images[run].double() - predicted.mean).square().sum(dim=1)
            expected = likelihood.log_prob(squared, predicted.variance, 6)
            torch.testing.assert_close(told[run], expected, rtol=1e-4, atol=1e-4)
