"""A network as it is, as the descriptor of a map: built, kept and loaded again, and nothing else loaded for it."""

import json

import numpy as np
import pytest
import torch

from sextant.chapters.places.backbone_layer import backbone_layer, layer_identity, layer_nodes, layer_of_file
from sextant.chapters.places.saved_descriptor import ARRAYS, HEADER, kept_layer, load_descriptor
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.layers import PushPullConv2d
from sextant.layers.inhibition import inhibited

SMALL = (
    "task=localization",
    "descriptor=network",
    "descriptor.height=32",
    "descriptor.width=48",
    "descriptor.grid=[2,3]",
)
IMAGES = np.random.default_rng(0).integers(0, 256, (12, 40, 60, 3), dtype=np.uint8)


def nodes(*overrides):
    return layer_nodes(to_plain(compose([*SMALL, "backbone=resnet18", "descriptor.dimensions=4", *overrides])))


@pytest.mark.parametrize(
    ("overrides", "numbers"),
    [
        ((), 2 * 512), (("descriptor.layer=layer1",), 6 * 64), (("pooling=gem",), 512), (("pooling=average",), 512),
        (("pooling=flatten", "descriptor.layer=layer2"), 128 * 4 * 6), (("backbone=resnet20", "pooling=gem"), 64),
        (("backbone=place_cnn",), 6 * 128), (("backbone=efficientnet_lite0", "backbone.stages=2"), 6 * 24),
        (("backbone=efficientnet_lite0", "backbone.stages=2", "backbone.weights=null"), 6 * 24),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)  # fmt: skip
def test_the_numbers_of_a_descriptor(overrides, numbers):
    layer = backbone_layer(nodes(*overrides, "descriptor.dimensions=null"))
    found = layer.describe(IMAGES[:3])
    assert found.shape == (3, numbers)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-5)


def test_inhibition_is_put_into_the_network_and_changes_what_it_sees():
    plain, other = (
        backbone_layer(nodes("descriptor.dimensions=null", f"inhibition={i}")) for i in ("none", "push_pull")
    )
    assert isinstance(other.features.network.conv1, PushPullConv2d)
    assert inhibited(plain.features) == []
    assert not np.allclose(plain.describe(IMAGES[:2]), other.describe(IMAGES[:2]), atol=1e-3)


def test_weights_that_are_drawn_follow_their_seed_alone():
    torch.manual_seed(3)
    one, state = backbone_layer(nodes()), torch.get_rng_state()
    torch.manual_seed(4)
    two, three = backbone_layer(nodes()), backbone_layer(nodes("descriptor.seed=1"))
    assert layer_identity(one, nodes()) == layer_identity(two, nodes())
    assert layer_identity(one, nodes()) != layer_identity(three, nodes())
    torch.manual_seed(3)
    assert torch.equal(torch.get_rng_state(), state)  # no random state of anybody else's is touched


@pytest.mark.parametrize(
    "overrides",
    [
        ("inhibition=push_pull",), ("pooling=gem",), ("backbone=efficientnet_lite0", "backbone.stages=2"),
        ("descriptor.dimensions=null",), ("backbone=place_cnn",),
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_kept_descriptor_describes_alike_wherever_it_lies(tmp_path, overrides):
    parts = nodes(*overrides)
    layer = backbone_layer(parts).fit(IMAGES)
    kept = kept_layer(layer, parts)
    kept.save(tmp_path)
    found = load_descriptor(tmp_path)
    assert found.identity == kept.identity
    np.testing.assert_allclose(found.describer.describe(IMAGES), layer.describe(IMAGES), atol=1e-5)


def test_weights_of_a_file_of_torchvisions_see_standardised_images(tmp_path):
    from safetensors.torch import save_file
    from torchvision.models import resnet18

    torch.manual_seed(0)
    save_file(resnet18().state_dict(), tmp_path / "weights.safetensors")
    parts = nodes(f"backbone.weights={tmp_path / 'weights.safetensors'}", "inhibition=push_pull")
    layer = backbone_layer(parts).fit(IMAGES)
    with torch.no_grad():  # an image of ImageNet's mean colour becomes zeros
        mean = torch.tensor([0.485, 0.456, 0.406]).view(1, 3, 1, 1).expand(1, 3, 32, 48)
        assert layer.features.network[0](mean).abs().max() < 1e-6
    kept_layer(layer, parts).save(tmp_path / "kept")
    (tmp_path / "weights.safetensors").unlink()  # a kept descriptor has its own
    found = load_descriptor(tmp_path / "kept").describer
    np.testing.assert_allclose(found.describe(IMAGES), layer.describe(IMAGES), atol=1e-5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda parts: parts["backbone"].update(_target_="os.system"), "os.system, which Sextant does not know"),
        (lambda parts: parts["inhibition"].update(_target_="subprocess.run"), "subprocess.run"),
        (lambda parts: parts["backbone"].update(name=3), "backbone is invalid"),
        (lambda parts: parts["descriptor"].update(grid=[0, 3]), "descriptor is invalid"),
        (lambda parts: parts.pop("backbone"), "backbone"),
    ],
    ids=["own code", "own inhibition", "wrong value", "no cell", "no backbone"],
)
def test_parts_of_a_file_are_checked_before_anything_is_built(change, says):
    parts = nodes("inhibition=push_pull")
    weights = backbone_layer(parts).features.state_dict()
    change(parts)
    with pytest.raises((UserError, ValueError, KeyError), match=says):
        layer_of_file(parts, weights, trust=False)


@pytest.mark.parametrize("harm", ["lost", "nan", "of another"])
def test_weights_that_do_not_fit_are_refused(harm):
    parts = nodes()
    weights = dict(backbone_layer(parts).features.state_dict())
    name = "network.conv1.weight"
    if harm == "lost":
        del weights[name]
    weights |= {"nan": {name: torch.full((64, 3, 7, 7), torch.nan)}, "of another": {name: torch.zeros(8, 3, 3, 3)}}.get(
        harm, {}
    )
    with pytest.raises(ValueError, match="not finite" if harm == "nan" else "Error"):
        layer_of_file(parts, weights, trust=False)


def test_a_changed_file_is_refused(tmp_path):
    parts = nodes()
    kept_layer(backbone_layer(parts).fit(IMAGES), parts).save(tmp_path)
    header = json.loads((tmp_path / HEADER).read_text())
    header["facts"]["nodes"]["backbone"]["name"] = "resnet34"
    (tmp_path / HEADER).write_text(json.dumps(header))
    with pytest.raises(UserError, match="was changed"):
        load_descriptor(tmp_path)
    (tmp_path / ARRAYS).write_bytes((tmp_path / ARRAYS).read_bytes()[:-1])
    with pytest.raises(UserError, match="is not the file that"):
        load_descriptor(tmp_path)
