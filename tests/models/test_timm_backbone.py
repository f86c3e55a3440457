"""timm's networks with weights from a file."""

from functools import partial

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from sextant.chapters.places.backbone_layer import backbone_layer
from sextant.chapters.places.chapter import _statistics
from sextant.chapters.places.network import place_network
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.building import build
from sextant.errors import UserError
from sextant.models import FeatureMap, timm_backbone
from sextant.models.standardize import Standardize
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


@pytest.mark.parametrize(
    ("name", "size", "grid"),
    [
        ("vit_small_patch14_dinov2", (28, 42), (2, 3)),
        ("vit_tiny_patch16_224", (64, 96), (4, 6)),
        ("eva02_tiny_patch14_224", (28, 42), (2, 3)),  # rotary positions
        ("xcit_nano_12_p16_224", (64, 96), (4, 6)),  # a class token that it does not declare
        ("mixer_s32_224", (64, 96), (2, 3)),  # no class token
        ("swin_tiny_patch4_window7_224", (112, 112), (4, 4)),  # channels last
    ],
)
def test_tokens_become_a_map(name, size, grid):
    network = timm_backbone(name, 3, size, 4).eval()
    image = torch.rand(1, 3, *size)
    with torch.no_grad():
        tokens = network.forward_features(image)
        features = FeatureMap(network, 3, size).eval()
        found = features(image)
    assert (features.channels, features.size) == (found.shape[1], grid)
    flat = found.flatten(2).transpose(1, 2)
    inner = tokens.flatten(1, 2) if tokens.ndim == 4 else tokens[:, tokens.shape[1] - grid[0] * grid[1] :]
    if name.startswith(("mixer", "swin")):  # their last norm comes after the map
        flat = network.norm(flat) if isinstance(network.norm, torch.nn.LayerNorm) else inner
    torch.testing.assert_close(flat, inner)


def test_positions_of_a_file_are_resampled_and_its_statistics_are_timms(tmp_path):
    name = "vit_tiny_patch16_224"
    torch.manual_seed(0)
    state = timm.create_model(name).state_dict()
    save_file(state, tmp_path / "vit.safetensors")
    network = timm_backbone(name, 3, (64, 96), 4, weights=str(tmp_path / "vit.safetensors"))
    assert network.pos_embed.shape == (1, 1 + 4 * 6, 192)
    torch.testing.assert_close(network.blocks[3].mlp.fc1.weight, state["blocks.3.mlp.fc1.weight"])
    state["another"] = torch.zeros(1)
    save_file(state, tmp_path / "wrong.safetensors")
    with pytest.raises(UserError, match="also holds another"):
        timm_backbone(name, 3, (64, 96), 4, weights=str(tmp_path / "wrong.safetensors"))
    words = ["task=localization", "backbone=timm", f"backbone.name={name}", "descriptor=network"]
    sizes = ["descriptor.height=64", "descriptor.width=96", f"backbone.weights={tmp_path / 'vit.safetensors'}"]
    plain = to_plain(compose([*words, *sizes]))
    layer = backbone_layer(plain)
    (standardize,) = (m for m in layer.features.modules() if isinstance(m, Standardize))
    assert standardize.mean.flatten().tolist() == [0.5, 0.5, 0.5]  # of timm's weights, not ImageNet's
    image = np.random.default_rng(0).integers(0, 255, (1, 64, 96, 3), dtype=np.uint8)
    layer.dimensions = None
    assert layer.describe(image).shape == (1, 4 * 6 * 192)


@pytest.mark.parametrize(
    ("words", "mean"),
    [
        (["backbone=timm", "backbone.name=vit_tiny_patch16_224", "backbone.weights=w"], [0.5, 0.5, 0.5]),
        (["backbone=timm", "backbone.name=resnet10t", "backbone.weights=w"], [0.485, 0.456, 0.406]),
        (["backbone=resnet18", "backbone.weights=w"], [0.485, 0.456, 0.406]),
        (["backbone=timm"], None),
        (["backbone=resnet18"], None),
        ([], None),
    ],
)
def test_new_runs_with_pretrained_weights_standardise_by_their_statistics(words, mean):
    config = validate(to_plain(compose(["task=place_recognition", *words])))
    assert _statistics(config, 3).get("mean") == mean
    spec = {"channels": 3, "height": 64, "width": 96, **_statistics(config, 3)}
    plain = {**config.plain, "backbone": {**config.plain["backbone"], "weights": None}}
    if mean is None:
        return
    network = place_network(plain, spec, partial(build, plain))
    assert network.standardize.mean.flatten().tolist() == pytest.approx(mean)
    earlier = place_network(plain, {"channels": 3, "height": 64, "width": 96}, partial(build, plain))
    assert earlier.standardize.mean.flatten().tolist() == [0.5, 0.5, 0.5]  # as stored runs were trained
