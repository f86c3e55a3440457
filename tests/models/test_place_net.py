"""Networks for places: maps within other networks, and descriptors."""

import pytest
import torch
from torch import nn

from sextant.errors import UserError
from sextant.layers import PushPullConv2d, PushPullInhibition
from sextant.models import (
    AlexNetCifar,
    CaffeNet,
    FeatureMap,
    LocalContrast,
    OrientedCNN,
    PlaceCNN,
    PlaceNet,
    ResNetCifar,
    StridedCNN,
    timm_backbone,
    torchvision_backbone,
)
from sextant.models.pooling import Average, Flatten, GeM, NetVLAD

SIZE = (32, 64)


def place_net(pool=Flatten, size=SIZE, dimension=128, **settings):
    torch.manual_seed(0)
    backbone = FeatureMap(PlaceCNN(3, size, 4), 3, size)
    return PlaceNet(backbone, pool(backbone.channels, backbone.size), dimension, **settings)


def weights(network):
    return sum(parameter.numel() for parameter in network.parameters())


def test_descriptors_have_unit_length_or_any():
    images = torch.rand(3, 3, *SIZE)
    unit, free = place_net()(images), place_net(normalise=False)(images)
    assert unit.shape == free.shape == (3, 128)
    torch.testing.assert_close(unit.norm(dim=1), torch.ones(3))
    torch.testing.assert_close(unit, free / free.norm(dim=1, keepdim=True))


@pytest.mark.parametrize("pool", [Flatten, Average, GeM, NetVLAD])
def test_a_picture_is_judged_alone_while_training(pool):
    network, images = place_net(pool), torch.rand(3, 3, *SIZE)
    torch.testing.assert_close(network(images[1:2]), network(images)[1:2], atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize(("size", "grid"), [((32, 64), None), ((64, 96), (4, 6))])
def test_the_small_network_has_less_than_a_million_weights(size, grid):
    backbone = FeatureMap(PlaceCNN(3, size, 4), 3, size)
    network = PlaceNet(backbone, Flatten(backbone.channels, backbone.size, grid=grid))
    assert weights(network) < 1_000_000
    assert network(torch.rand(2, 3, *size)).shape == (2, 128)


def test_every_weight_is_trained():
    network = place_net()
    network(torch.rand(2, 3, *SIZE))[:, 0].sum().backward()
    assert all(parameter.grad is not None and parameter.grad.any() for parameter in network.parameters())


def test_without_projection_the_pooling_is_the_descriptor():
    backbone = FeatureMap(PlaceCNN(3, SIZE, 4), 3, SIZE)
    network = PlaceNet(backbone, Average(128, backbone.size), 128, project=False)
    images = torch.rand(2, 3, *SIZE)
    pooled = network.feature_map(images).mean((2, 3))
    torch.testing.assert_close(network(images), pooled / pooled.norm(dim=1, keepdim=True))
    with pytest.raises(ValueError, match="not 64"):
        PlaceNet(backbone, Average(128, backbone.size), 64, project=False)


def test_images_are_standardised_by_channel():
    seen = []
    watch = nn.Identity()
    watch.register_forward_hook(lambda module, inputs, output: seen.append(output))
    mean, std = (0.1, 0.2, 0.3), (0.5, 0.25, 0.2)
    PlaceNet(watch, Average(3, SIZE), 4, mean=mean, std=std)(torch.ones(1, 3, *SIZE))
    PlaceNet(watch, Average(3, SIZE), 4)(torch.ones(1, 3, *SIZE))
    torch.testing.assert_close(seen[0][0, :, 0, 0], torch.tensor([1.8, 3.2, 3.5]))
    assert torch.equal(seen[1], torch.ones(1, 3, *SIZE))


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("where", ["first", "first_block", "all"])
def test_inhibition_goes_into_the_network_or_its_backbone(where, whole):
    network, images = place_net(), torch.rand(2, 3, *SIZE)
    before = network(images)
    PushPullInhibition(scale=1.0, alpha=1.0, where=where)(network if whole else network.backbone)
    assert any(isinstance(module, PushPullConv2d) for module in network.modules())
    torch.testing.assert_close(network(images), before, atol=1e-5, rtol=1e-4)
    PushPullInhibition(where="first")(place_net())


def test_netvlad_starts_from_the_features_of_images():
    images = torch.rand(6, 3, *SIZE)
    first, second = place_net(NetVLAD), place_net(NetVLAD)
    before = first.pooling.centres.detach().clone()
    assert first.initialise_pooling(images, torch.Generator().manual_seed(0), most=100)
    assert second.initialise_pooling(images, torch.Generator().manual_seed(0), most=100)
    assert not torch.equal(first.pooling.centres, before)
    assert torch.equal(first.pooling.centres, second.pooling.centres)
    assert not place_net().initialise_pooling(images, torch.Generator())


@pytest.mark.parametrize(
    ("make", "layer", "channels"),
    [
        (lambda: PlaceCNN(3, SIZE, 4), None, 128),
        (lambda: StridedCNN(3, (64, 96), 4), None, 160),
        (lambda: OrientedCNN(3, (64, 96), 4), None, 160),
        (lambda: ResNetCifar(3, SIZE, 4, depth=8), None, 64),
        (lambda: AlexNetCifar(3, SIZE, 4), "features.9", 256),
        (lambda: CaffeNet(3, (64, 96), 4), "features.conv3", 384),
        (lambda: torchvision_backbone("resnet18", 3, SIZE, 4), None, 512),
        (lambda: torchvision_backbone("resnet18", 3, SIZE, 4), "layer2.0", 128),
        (lambda: torchvision_backbone("mobilenet_v3_small", 3, SIZE, 4), None, 576),
        (lambda: timm_backbone("mobilenetv3_small_100", 3, SIZE, 4), None, 576),
    ],
)
def test_a_map_is_the_output_of_the_layer_without_what_follows(make, layer, channels):
    torch.manual_seed(0)
    network = make().eval()
    size, seen = (64, 96), []
    with torch.no_grad():
        hook = network.get_submodule(layer or FeatureMap(make(), 3, size).layer).register_forward_hook(
            lambda module, inputs, output: seen.append(output.clone())
        )
        images = torch.randn(2, 3, *size)
        try:
            network(images)
        except RuntimeError:  # a head for images of another size
            assert len(seen) == 1
        hook.remove()
        before = weights(network)
        part = FeatureMap(network, 3, size, layer=layer)
        found = part(images)
    torch.testing.assert_close(found, seen[0])
    assert found.shape[1:] == (part.channels, *part.size)
    assert part.channels == channels
    assert weights(part) < before
    part.train()(images).square().mean().backward()
    assert all(parameter.grad is not None for parameter in part.parameters())


def test_a_map_survives_inhibition_and_leaves_no_hooks():
    part = FeatureMap(torchvision_backbone("alexnet", 3, (64, 64), 4), 3, (64, 64), layer="features.3")
    assert len(list(part.network.features)) == 13
    assert [type(module) for module in part.network.features][4:] != []
    images = torch.rand(1, 3, 64, 64)
    before = part(images)
    PushPullInhibition(scale=1.0, where="all")(part)
    torch.testing.assert_close(part(images), before, atol=1e-5, rtol=1e-4)
    assert isinstance(part.network.features[3], PushPullConv2d)
    assert not any(module._forward_hooks or module._forward_pre_hooks for module in part.modules())
    assert weights(part) == weights(part.network.features[0]) + weights(part.network.features[3])


def of_timm(name, **smaller):
    timm = pytest.importorskip("timm")
    sizes = {"regnetx_002": {}, "vit_small_patch14_dinov2": {}}
    return timm.create_model(name, num_classes=4, **sizes.get(name, {"img_size": SIZE}), **smaller)


@pytest.mark.parametrize(
    ("make", "size", "layer", "told"),
    [
        (lambda: nn.Sequential(nn.Conv2d(3, 4, 3)), SIZE, None, "layer4"),
        (lambda: PlaceCNN(3, SIZE, 4), SIZE, "layer9", "layer9.*PlaceCNN(?s:.*)features"),
        (lambda: PlaceCNN(3, SIZE, 4), SIZE, "head", r"\(1, 4\), not"),
        (lambda: CaffeNet(3, SIZE, 4), SIZE, "features.pool5", "32x64.*pool5"),
        (lambda: torchvision_backbone("googlenet", 3, SIZE, 4), SIZE, "aux1", "is not used by"),
        (lambda: of_timm("vit_small_patch14_dinov2", depth=1), (96, 128), None, "96x128(?s:.*)layer"),
        (lambda: of_timm("regnetx_002"), SIZE, None, "no layer named any of(?s:.*)s4"),
    ],
)
def test_a_layer_that_gives_no_map_is_named(make, size, layer, told):
    with pytest.raises(UserError, match=told):
        FeatureMap(make(), 3, size, layer=layer)


def test_local_contrast_forgets_brightness_and_contrast():
    torch.manual_seed(0)
    x, layer = torch.rand(1, 3, 20, 30), LocalContrast(7)
    torch.testing.assert_close(layer(x + 0.3), layer(x), atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(layer(x * 8), layer(x), atol=0.02, rtol=0.02)
    flat = torch.full((1, 3, 9, 9), 0.4, requires_grad=True)
    layer(flat).sum().backward()
    assert layer(flat).abs().max() < 1e-4
    assert flat.grad.isfinite().all()


def test_local_contrast_is_the_loop_over_the_part_of_the_window_within_the_image():
    torch.manual_seed(1)
    x, half = torch.rand(1, 2, 6, 7).double(), 1
    grey = x.mean(1)[0]

    def mean_around(image, i, j):
        return image[max(0, i - half) : i + half + 1, max(0, j - half) : j + half + 1].mean()

    centred = torch.stack(
        [torch.stack([x[0, :, i, j] - mean_around(grey, i, j) for j in range(7)], 1) for i in range(6)], 1
    )
    square = centred.square().mean(0)
    expected = torch.stack(
        [
            torch.stack([centred[:, i, j] / (mean_around(square, i, j) + 0.02**2).sqrt() for j in range(7)], 1)
            for i in range(6)
        ],
        1,
    )
    torch.testing.assert_close(LocalContrast(3)(x)[0], expected)


def test_networks_name_what_is_wrong_with_them():
    with pytest.raises(ValueError, match="as many strides"):
        PlaceCNN(3, SIZE, 4, strides=(1, 2))
    with pytest.raises(ValueError, match="too small"):
        PlaceCNN(3, (4, 64), 4)
    with pytest.raises(ValueError, match="odd"):
        PlaceCNN(3, SIZE, 4, window=4)
    with pytest.raises(ValueError, match="19x19"):
        CaffeNet(3, (18, 64), 4)
    with pytest.raises(ValueError, match="dimension"):
        PlaceNet(nn.Identity(), Average(3, SIZE), 0)
