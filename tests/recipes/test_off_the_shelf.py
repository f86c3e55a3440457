"""Networks trained for something else, from local files alone: found, loaded safely, cut; and mistakes."""

import hashlib
import pickle

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from support import as_published
from torchvision import models

from sextant.chapters.places.config import OffTheShelf
from sextant.chapters.places.off_the_shelf import off_the_shelf, weights_identity
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.models import ResNetCifar
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD

IMAGES = np.random.default_rng(0).integers(0, 256, (3, 64, 96, 3)).astype(np.uint8)


@pytest.fixture(scope="module")
def squeezenet(tmp_path_factory):
    """A torchvision classifier with weights of its own, and its state dict in both formats."""
    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(1)
    network = models.squeezenet1_1().eval()
    torch.save(network.state_dict(), folder / "squeezenet.pth")
    save_file(network.state_dict(), folder / "squeezenet.safetensors")
    return network, folder


@pytest.mark.parametrize("suffix", ["pth", "safetensors"])
def test_a_layer_of_a_classifier_from_a_file_is_what_torchvision_computes(squeezenet, suffix, tmp_path):
    network, folder = squeezenet
    path = folder / f"squeezenet.{suffix}"
    shelf = OffTheShelf(weights=str(path), network="squeezenet1_1", layer="features.4", grid=[2, 3])
    name, layer = off_the_shelf(shelf, (64, 96), tmp_path)
    assert name == "off the shelf: squeezenet1_1 features.4"
    mean, std = (torch.tensor(values).view(3, 1, 1) for values in (IMAGENET_MEAN, IMAGENET_STD))
    images = (torch.from_numpy(IMAGES).permute(0, 3, 1, 2).float() / 255 - mean) / std
    with torch.no_grad():
        expected = torch.nn.functional.adaptive_avg_pool2d(network.features[:5](images), (2, 3)).flatten(1)
    expected = torch.nn.functional.normalize(expected, dim=1).numpy()
    np.testing.assert_allclose(layer.describe(IMAGES), expected, atol=1e-5)
    assert weights_identity(shelf, tmp_path) == hashlib.sha256(path.read_bytes()).hexdigest()


def test_images_may_be_brought_to_the_size_that_a_network_knows(squeezenet, tmp_path):
    _, folder = squeezenet
    shelf = OffTheShelf(weights=str(folder / "squeezenet.pth"), network="squeezenet1_1", size=[112, 112])
    name, layer = off_the_shelf(shelf, (64, 96), tmp_path)
    assert (layer.height, layer.width) == (112, 112)
    assert name.endswith(" features")  # the usual last map
    assert layer.describe(IMAGES).shape[0] == 3


def test_a_timm_network_from_a_file(tmp_path):
    timm = pytest.importorskip("timm")
    torch.manual_seed(0)
    network = timm.create_model("mobilenetv3_small_050").eval()
    torch.save(network.state_dict(), tmp_path / "weights.pth")
    shelf = OffTheShelf(weights=str(tmp_path / "weights.pth"), network="mobilenetv3_small_050", layer="blocks.2")
    name, layer = off_the_shelf(shelf, (64, 96), tmp_path)
    assert name == "off the shelf: mobilenetv3_small_050 blocks.2"
    torch.save(timm.create_model("mobilenetv3_small_050").state_dict(), tmp_path / "weights.pth")  # other weights
    other = off_the_shelf(shelf, (64, 96), tmp_path)[1]
    assert not np.allclose(layer.describe(IMAGES), other.describe(IMAGES))


def test_a_published_network_of_push_pull(tmp_path):
    torch.manual_seed(0)
    network = ResNetCifar(3, (32, 32), 10, depth=8).eval()
    path = as_published(network, tmp_path / "checkpoint.pth.tar")
    name, layer = off_the_shelf(OffTheShelf(weights=str(path), layer="layer2", grid=[4, 4]), (64, 96), tmp_path)
    assert name == "off the shelf: ResNetCifar layer2"
    with torch.no_grad():
        x = network.standardize(torch.from_numpy(IMAGES).permute(0, 3, 1, 2).float() / 255)
        x = network.layer2(network.layer1(torch.relu(network.bn1(network.conv1(x)))))
    expected = torch.nn.functional.adaptive_avg_pool2d(x, 4).flatten(1)
    np.testing.assert_allclose(layer.describe(IMAGES), torch.nn.functional.normalize(expected, dim=1), atol=1e-5)


class Malicious:
    def __reduce__(self):
        return (pytest.fail, ("it was executed",))


@pytest.mark.parametrize(
    ("shelf", "said"),
    [
        ({"weights": "none.pth", "network": "alexnet"}, r"off_the_shelf\.weights=none\.pth does not exist"),
        ({"weights": "none"}, r"task\.off_the_shelf\.weights=none: no run, run directory or checkpoint"),
        ({"weights": "FILE", "network": "squeezenet1_0"}, r"task\.off_the_shelf\.weights=.*cannot be loaded"),
        ({"weights": "FILE", "network": "squeezenet9"}, r"off_the_shelf\.network='squeezenet9' is not"),
        ({"weights": "FILE", "network": "squeezenet1_1", "layer": "conv"}, r"off_the_shelf: layer='conv' is not a"),
        ({"weights": "FILE", "network": "squeezenet1_1", "layer": "classifier.9"}, "is not a layer of SqueezeNet"),
        ({"weights": "BAD", "network": "squeezenet1_1"}, "cannot be loaded"),
        ({"weights": "BAD"}, r"task\.off_the_shelf: .*BAD.* is not a plain checkpoint|cannot be read"),
    ],
)  # fmt: skip
def test_mistakes_name_the_key(squeezenet, tmp_path, shelf, said):
    _, folder = squeezenet
    bad = tmp_path / "BAD"
    bad.write_bytes(pickle.dumps({"state_dict": Malicious()}, protocol=2))
    files = {"FILE": str(folder / "squeezenet.pth"), "BAD": str(bad)}
    shelf = shelf | {"weights": files.get(shelf["weights"], shelf["weights"])}
    with pytest.raises(UserError, match=said):
        off_the_shelf(OffTheShelf(**shelf), (64, 96), tmp_path)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("{weights: imagenet}", "needs a network"),
        ("{network: alexnet}", r"task\.off_the_shelf\.weights is missing"),
        ("{weights: x, grid: [0, 2]}", r"task\.off_the_shelf\.grid"),
        ("{weights: x, layers: y}", r"task\.off_the_shelf\.layers: unknown key.*layer"),
    ],
)
def test_configs_with_mistakes(value, said):
    with pytest.raises(UserError, match=said):
        validate(to_plain(compose(["task=place_recognition", f"task.off_the_shelf={value}"])))
