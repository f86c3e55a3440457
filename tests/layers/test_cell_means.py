"""Means over cells: those of PyTorch, and the products that take their place where a GPU is to repeat itself."""

import pytest
import torch
import torch.nn.functional as F

from sextant.layers.cell_means import _by_products, cell_means

CASES = [((7, 7), (7, 7)), ((5, 9), (3, 4)), ((12, 16), (3, 4)), ((3, 4), (1, 1)), ((6, 5), (4, 2))]


@pytest.mark.parametrize(("size", "grid"), CASES)
def test_products_are_the_means_and_have_their_gradient(size, grid):
    x = torch.rand(2, 3, *size, dtype=torch.float64, requires_grad=True)
    expected, found = F.adaptive_avg_pool2d(x, grid), _by_products(x, grid)
    torch.testing.assert_close(found, expected)
    weights = torch.rand_like(found)
    gradients = [torch.autograd.grad((each * weights).sum(), x)[0] for each in (found, expected)]
    torch.testing.assert_close(*gradients)


def test_a_cpu_has_those_of_pytorch():
    x = torch.rand(2, 3, 5, 9)
    assert torch.equal(cell_means(x, (3, 4)), F.adaptive_avg_pool2d(x, (3, 4)))


@pytest.mark.gpu
@pytest.mark.parametrize(("size", "grid"), CASES)
def test_a_gpu_that_is_to_repeat_itself_trains_through_them(size, grid):
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    x, weights = torch.rand(2, 3, *size, requires_grad=True), torch.rand(2, 3, *grid)
    (expected,) = torch.autograd.grad((F.adaptive_avg_pool2d(x, grid) * weights).sum(), x)
    there = x.detach().cuda().requires_grad_()
    torch.use_deterministic_algorithms(True)  # under which PyTorch's own refuses
    try:
        (found,) = torch.autograd.grad((cell_means(there, grid) * weights.cuda()).sum(), there)
    finally:
        torch.use_deterministic_algorithms(False)
    torch.testing.assert_close(found.cpu(), expected)
