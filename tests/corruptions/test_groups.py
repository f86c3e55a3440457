"""Where the corruptions are: one looks in the folder of a family."""

import pytest

from sextant.corruptions import cifar10_c, imagenet_c, mnist_c
from sextant.evaluation import CORRUPTION_FAMILIES

#: what the authors added for validation, by its nature
EXTRA = {"speckle_noise": "noise", "gaussian_blur": "blur", "spatter": "weather", "saturate": "digital"}
#: what MNIST-C alone has
SHAPES = {"shear", "scale", "rotate", "translate", "stripe", "dotted_line", "zigzag", "canny_edges"}


def group(corruption):
    return type(corruption).__module__.removeprefix("sextant.corruptions.").split(".")[0]


@pytest.mark.parametrize("corruptions", [cifar10_c(), imagenet_c()], ids=["cifar10_c", "imagenet_c"])
def test_a_corruption_lies_in_the_folder_of_its_family(corruptions):
    families = {name: family for family, names in CORRUPTION_FAMILIES.items() for name in names} | EXTRA
    assert {name: group(corruption) for name, corruption in corruptions.items()} == families


def test_what_mnist_c_alone_has_are_shapes():
    ours = {name: group(corruption) for name, corruption in mnist_c().items()}
    assert {name for name, where in ours.items() if where == "shapes"} == SHAPES
