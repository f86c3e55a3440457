import numpy as np
import torch
from skimage.feature import canny

from sextant.corruptions import corrupt
from sextant.corruptions.shapes import CannyEdges

EDGES = CannyEdges(((),), "canny_edges", levels=(1,))


def test_edges_of_8_bit_images_are_those_in_double_precision():
    bytes_ = np.random.default_rng(0).integers(0, 256, (8, 12, 12), dtype=np.uint8).repeat(3, 1).repeat(3, 2)
    edges = EDGES(torch.from_numpy(bytes_)[:, None].float() / 255, 1, torch.arange(8), 0)
    expected = np.stack([canny(image / 255.0) for image in bytes_])
    assert np.array_equal(edges[:, 0].numpy(), expected.astype(np.float32))
    assert 0.02 < edges.mean() < 0.5


def test_colours_show_the_edges_of_their_luma_in_every_channel():
    colours = torch.zeros(1, 3, 16, 16)
    colours[:, 1, :, 8:] = 1
    edges = EDGES(colours, 1, torch.arange(1), 0)
    assert torch.equal(edges[:, 0], edges[:, 1])
    assert torch.equal(edges[:, 0], edges[:, 2])
    assert edges.unique().tolist() == [0, 1]
    assert set(edges[0, 0, 8].nonzero().flatten().tolist()) <= {7, 8}


def test_a_uniform_image_has_no_edges():
    assert EDGES(torch.full((1, 1, 28, 28), 0.7), 1, torch.arange(1), 0).sum() == 0


def test_edges_of_images_with_gradients_are_the_same():
    image = torch.rand(1, 28, 28, generator=torch.Generator().manual_seed(0))
    expected = corrupt(image, "canny_edges", 1, set="mnist_c")
    assert torch.equal(corrupt(image.requires_grad_(), "canny_edges", 1, set="mnist_c"), expected)
