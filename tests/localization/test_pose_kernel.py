import math

import gpytorch
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from sextant.localization.pose_kernel import SPATIAL, PoseKernel

kernels = st.builds(
    PoseKernel,
    spatial=st.sampled_from(SPATIAL),
    length=st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)),
    heading_length=st.floats(0.1, 5),
    signal_variance=st.floats(0.1, 10),
    noise_variance=st.just(0.0),
)


def _poses(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(count, 3, dtype=torch.float64, generator=generator) * torch.tensor([3.0, 2.0, 4.0])


def _double(value):
    return torch.tensor(value, dtype=torch.float64)


@given(kernels, st.integers(0, 9))
def test_it_is_positive_semidefinite(kernel, seed):
    poses = _poses(40, seed)
    poses[20:, :2] = poses[0, :2]  # many headings at one place
    smallest = torch.linalg.eigvalsh(kernel(poses, poses))[0]
    assert smallest > -1e-12 * 40 * kernel.signal_variance


def test_a_squared_exponential_of_the_wrapped_angle_would_not_be():
    """The reason for the chord: the test above can fail."""
    heading = torch.linspace(-math.pi, math.pi, 41, dtype=torch.float64)[:-1]
    apart = torch.remainder(heading[:, None] - heading + math.pi, 2 * math.pi) - math.pi
    assert torch.linalg.eigvalsh(torch.exp(-(apart**2) / (2 * 2.0**2)))[0] < -1e-3


@given(kernels, st.integers(-3, 3))
def test_full_turns_change_nothing(kernel, turns):
    a, b = _poses(6), _poses(5, seed=1)
    turned = a + torch.tensor([0.0, 0.0, turns * 2 * math.pi], dtype=torch.float64)
    torch.testing.assert_close(kernel(turned, b), kernel(a, b), rtol=1e-11, atol=1e-12)


@given(kernels)
def test_it_is_symmetric_and_the_signal_variance_at_one_pose(kernel):
    poses = _poses(7)
    covariance = kernel(poses, poses)
    torch.testing.assert_close(covariance, covariance.T, rtol=1e-13, atol=0)
    torch.testing.assert_close(covariance.diagonal(), torch.full((7,), kernel.signal_variance, dtype=torch.float64))


@given(kernels)
def test_with_rbf_it_is_the_squared_exponential_on_the_features(kernel):
    kernel = PoseKernel("rbf", kernel.length, kernel.heading_length, kernel.signal_variance, 0.0)
    a, b = _poses(6), _poses(5, seed=1)
    square = torch.cdist(kernel.features(a), kernel.features(b)).square()
    torch.testing.assert_close(kernel(a, b), kernel.signal_variance * torch.exp(-square / 2), rtol=1e-9, atol=1e-12)


@given(kernels)
def test_it_equals_gpytorch(kernel):
    spatial = {
        "rbf": lambda: gpytorch.kernels.RBFKernel(ard_num_dims=2, active_dims=(0, 1)),
        "matern32": lambda: gpytorch.kernels.MaternKernel(1.5, ard_num_dims=2, active_dims=(0, 1)),
        "matern52": lambda: gpytorch.kernels.MaternKernel(2.5, ard_num_dims=2, active_dims=(0, 1)),
    }[kernel.spatial]().double()
    spatial.lengthscale = torch.tensor(kernel.length, dtype=torch.float64)
    turning = gpytorch.kernels.PeriodicKernel(active_dims=(2,)).double()
    # as tensors: GPyTorch would round plain numbers to float32
    turning.period_length, turning.lengthscale = _double(2 * math.pi), _double(kernel.heading_length**2)
    theirs = gpytorch.kernels.ScaleKernel(spatial * turning).double()
    theirs.outputscale = _double(kernel.signal_variance)
    a, b = _poses(6), _poses(5, seed=1)
    # GPyTorch expands squared distances, which costs it a few of the last digits
    torch.testing.assert_close(kernel(a, b), theirs(a, b).to_dense().detach(), rtol=1e-10, atol=1e-12)


@given(kernels)
def test_batches_are_many_single_ones(kernel):
    a, b = _poses(12).view(3, 4, 3), _poses(5, seed=1)
    together = kernel(a, b)
    assert together.shape == (3, 4, 5)
    for row in range(3):
        torch.testing.assert_close(together[row], kernel(a[row], b))


def test_covariance_falls_with_distance_and_turning():
    kernel = PoseKernel("matern32", (2.0, 1.0), 0.5, 1.0, 0.0)
    origin = torch.zeros(1, 3, dtype=torch.float64)
    for axis, reach in ((0, 6.0), (1, 6.0), (2, math.pi)):
        away = torch.zeros(30, 3, dtype=torch.float64)
        away[:, axis] = torch.linspace(0, reach, 30)
        assert (kernel(origin, away)[0].diff() < 0).all()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"spatial": "cubic"}, "spatial='cubic'"),
        ({"length": (1.0, 0.0)}, r"length=\(1.0, 0.0\)"),
        ({"length": (1.0, math.nan)}, "length="),
        ({"length": (1.0, math.inf)}, "length="),
        ({"length": (1.0,)}, "length="),
        ({"length": (1.0, 2.0, 3.0)}, "length="),
        ({"heading_length": -1.0}, "heading_length=-1"),
        ({"signal_variance": math.inf}, "signal_variance=inf"),
        ({"noise_variance": -1e-9}, "noise_variance=-1e-09"),
        ({"noise_variance": math.nan}, "noise_variance=nan"),
    ],
)
def test_values_out_of_range_are_refused(change, told):
    good = {
        "spatial": "rbf",
        "length": (1.0, 1.0),
        "heading_length": 1.0,
        "signal_variance": 1.0,
        "noise_variance": 0.0,
    }
    with pytest.raises((ValueError, TypeCheckError), match=f"{told}|Type-check error"):
        PoseKernel(**good | change)
