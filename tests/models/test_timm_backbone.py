"""timm's networks with weights from a file."""

import pytest
import torch
from safetensors.torch import save_file

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.building import build
from sextant.errors import UserError
from sextant.models import timm_backbone
from sextant.registry import chapter_of

timm = pytest.importorskip("timm")
NAME = "resnet10t"


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return timm.create_model(NAME).eval()


@pytest.mark.parametrize("suffix", ["safetensors", "pth"])
def test_its_weights_come_from_a_file_and_its_head_is_new(network, tmp_path, suffix):
    path = tmp_path / f"weights.{suffix}"
    (save_file if suffix == "safetensors" else torch.save)(network.state_dict(), path)
    raw = to_plain(compose(["backbone=timm", f"backbone.name={NAME}", f"backbone.weights={path}"]))
    assert validate(raw).model_dump(by_alias=True)["backbone"]["weights"] == str(path)
    built = build(raw, "backbone", in_channels=6, image_size=(64, 64), num_classes=7).eval()
    colours = torch.rand(2, 3, 64, 64)
    images = torch.cat([colours, torch.rand(2, 3, 64, 64)], 1)
    with torch.no_grad():
        torch.testing.assert_close(built.forward_features(images), network.forward_features(colours))
        assert built(images).shape == (2, 7)


def test_keys_that_do_not_fit_are_named(network, tmp_path):
    state = network.state_dict()
    state["another"] = state.pop("fc.bias")
    torch.save(state, tmp_path / "weights.pth")
    with pytest.raises(UserError, match=r"lacks fc\.bias \(1 in all\); it also holds another \(1 in all\)"):
        timm_backbone(NAME, 3, (64, 64), 7, weights=str(tmp_path / "weights.pth"))


def test_a_run_is_identified_by_what_the_file_holds(tmp_path):
    def identity(name, content):
        (tmp_path / name).write_bytes(content)
        config = validate(to_plain(compose(["backbone=timm", f"backbone.weights={tmp_path / name}"])))
        return chapter_of("classification").identity(config)

    assert identity("a", b"1") == identity("b", b"1") != identity("c", b"2")


def test_a_missing_file_is_named(tmp_path):
    raw = to_plain(compose(["backbone=timm", f"backbone.name={NAME}", f"backbone.weights={tmp_path / 'gone'}"]))
    with pytest.raises(UserError, match=r"backbone\.weights=.*gone cannot be loaded: .*No such file"):
        build(raw, "backbone", in_channels=3, image_size=(64, 64), num_classes=7)


def test_a_config_without_a_file_is_identified_as_before():
    config = validate(to_plain(compose(["backbone=timm"])))
    assert "weights" not in config.model_dump(by_alias=True)["backbone"]


@pytest.mark.parametrize("name", ["levit_128s", "xcit_nano_12_p16_224"])  # seen when it is run, when it is made
def test_a_network_that_cannot_take_images_of_this_size_is_refused(name):
    with pytest.raises(UserError, match=rf"name={name} cannot take images of 100x130: (?s:.*)of another size"):
        timm_backbone(name, 3, (100, 130), 4)
