import gpytorch
import pytest
import torch
from localization.observation.battery import log_density
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.hyperparameters import TrainableKernel, joint_log_likelihood
from sextant.localization.pose_kernel import PoseKernel


class OneOutput(gpytorch.models.ExactGP):
    def __init__(self, poses, values, likelihood, kernel):
        super().__init__(poses, values, likelihood)
        self.mean, self.kernel = gpytorch.means.ZeroMean(), kernel.covariance

    def forward(self, poses):
        return gpytorch.distributions.MultivariateNormal(self.mean(poses), self.kernel(poses))


@pytest.mark.parametrize("spatial", ["rbf", "matern32", "matern52"])
def test_it_is_the_sum_of_the_likelihoods_of_single_outputs(spatial):
    """GPyTorch's ExactMarginalLogLikelihood, one model an output."""
    poses = poses_in_room(40)
    descriptors = descriptors_at(poses, 4)
    kernel = TrainableKernel(PoseKernel(spatial, (1.5, 1.0), 0.8, 1.3, 0.2))
    mean = descriptors.mean(0)
    total = 0.0
    for output in range(4):
        likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
        likelihood.noise = 0.2
        model = OneOutput(poses, (descriptors[:, output] - mean[output]).double(), likelihood, kernel).double()
        marginal = gpytorch.ExactMarginalLogLikelihood(likelihood, model)
        model.train()
        total += 40 * marginal(model(poses), model.train_targets).item()  # theirs is divided by the number of data
    ours = joint_log_likelihood(kernel, poses, descriptors, mean).item()
    assert ours == pytest.approx(total, rel=1e-6)


def test_it_is_the_density_of_one_normal_distribution():
    known = smooth_map(80)
    ours = joint_log_likelihood(TrainableKernel(KERNEL), known.poses, known.descriptors, known.mean).item()
    assert ours == pytest.approx(log_density(known, KERNEL), rel=1e-6)


@pytest.mark.parametrize("spatial", ["rbf", "matern32", "matern52"])
def test_gradients_are_those_of_finite_differences(spatial):
    poses = poses_in_room(8)
    descriptors = descriptors_at(poses, 3).double()
    kernel = TrainableKernel(PoseKernel(spatial, (1.5, 1.0), 0.8, 1.3, 0.2))
    names = [name for name, parameter in kernel.named_parameters() if parameter.requires_grad]
    assert len(names) == 4  # lengths, heading, signal, noise

    def likelihood(*values):
        arguments = (poses, descriptors, descriptors.mean(0))
        return _Wrapped(kernel).call(dict(zip(names, values, strict=True)), *arguments)

    start = tuple(dict(kernel.named_parameters())[name].detach().clone().requires_grad_() for name in names)
    assert torch.autograd.gradcheck(likelihood, start)


class _Wrapped(torch.nn.Module):
    def __init__(self, kernel):
        super().__init__()
        self.kernel = kernel

    def forward(self, *arguments):
        return joint_log_likelihood(self.kernel, *arguments)

    def call(self, parameters, *arguments):
        named = {f"kernel.{name}": value for name, value in parameters.items()}
        return torch.func.functional_call(self, named, arguments)


def test_images_at_one_place_without_noise_are_refused():
    kernel = TrainableKernel(PoseKernel("rbf", (1e6, 1e6), 1.0, 1.0, 1e-18))
    with pytest.raises(UserError, match="noise variance"):
        joint_log_likelihood(kernel, poses_in_room(50) * torch.tensor([1, 1, 0]), torch.randn(50, 2), torch.zeros(2))
