import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.models import LeNet

sides = st.integers(12, 40)


@given(st.sampled_from("ABCD"), st.sampled_from([1, 3]), sides, sides, st.integers(2, 12))
def test_every_variant_gives_one_logit_a_class_for_images_of_any_size(variant, channels, height, width, classes):
    network = LeNet(variant, channels, (height, width), classes)
    assert network(torch.rand(2, channels, height, width)).shape == (2, classes)


@pytest.mark.parametrize(
    ("variant", "by_layer"),
    [
        ("A", [6 * 25 + 6, 16 * 6 * 25 + 16, 16 * 5 * 5 * 128 + 128, 128 * 64 + 64, 64 * 10 + 10]),
        ("B", [6 * 25 + 6, 8 * 6 * 25 + 8, 8 * 5 * 5 * 64 + 64, 64 * 32 + 32, 32 * 10 + 10]),
        ("C", [4 * 25 + 4, 16 * 4 * 25 + 16, 16 * 5 * 5 * 128 + 128, 128 * 64 + 64, 64 * 10 + 10]),
        ("D", [4 * 25 + 4, 8 * 4 * 25 + 8, 8 * 5 * 5 * 64 + 64, 64 * 32 + 32, 32 * 10 + 10]),
    ],
)
def test_parameters_on_mnist_are_those_of_the_papers_table(variant, by_layer):
    network = LeNet(variant, 1, (28, 28), 10)
    assert [sum(p.numel() for p in layer.parameters()) for layer in network.children()] == by_layer


@pytest.mark.parametrize("image_size", [(11, 28), (28, 11), (4, 4)])
def test_images_that_pooling_would_consume_are_refused(image_size):
    with pytest.raises(ValueError, match=f"at least 12x12 pixels, got {image_size[0]}x{image_size[1]}"):
        LeNet("A", 1, image_size, 10)
