import pytest
import torch

from sextant.errors import UserError
from sextant.models import CalibrationNet, StridedCNN, coordinate_channels, timm_backbone, torchvision_backbone
from sextant.models.torchvision_backbone import torchvision_classifier


def net(coordinates=True):
    torch.manual_seed(0)
    return CalibrationNet(
        StridedCNN(6 if coordinates else 3, (72, 96), 32, widths=(8, 16, 24)), 32, coordinates=coordinates
    )


def test_numbers_stay_within_their_ranges_whatever_the_image():
    images = torch.cat([torch.zeros(1, 3, 72, 96), torch.ones(1, 3, 72, 96), 1e4 * torch.randn(2, 3, 72, 96)])
    unit, log_scale, _ = net()(images, torch.full((4,), 4 / 3))
    assert unit.shape == log_scale.shape == (4, 4)
    assert ((unit >= 0) & (unit <= 1)).all()
    assert log_scale.isfinite().all()


def test_expected_errors_do_not_shape_the_features():
    network = net()
    output = network(torch.rand(2, 3, 72, 96), torch.full((2,), 4 / 3))
    output.log_scale.sum().backward()
    assert all(parameter.grad is None for parameter in network.backbone.parameters())
    assert all(parameter.grad is not None for parameter in network.scales.parameters())


def test_a_picture_is_judged_alone():
    network, images, aspect = net(), torch.rand(3, 3, 72, 96), torch.tensor([1.0, 4 / 3, 1.5])
    together, alone = network(images, aspect).unit, network(images[1:2], aspect[1:2]).unit
    torch.testing.assert_close(together[1:2], alone)


def test_coordinates_are_image_heights_from_the_centre():
    u, v, square = coordinate_channels(72, 96, torch.tensor([4 / 3, 2.0])).unbind(1)
    torch.testing.assert_close(u[0, 0, 0], torch.tensor(-2 / 3 + 0.5 / 72))
    torch.testing.assert_close(u[1, 0, -1], torch.tensor(1 - 1 / 96))
    torch.testing.assert_close(v[0, 0, 0], torch.tensor(-0.5 + 0.5 / 72))
    torch.testing.assert_close(square, u * u + v * v)
    assert u.sum().abs() < 1e-2
    assert v.sum().abs() < 1e-2


def test_without_coordinates_a_network_cannot_tell_the_aspect():
    network, images = net(coordinates=False), torch.rand(1, 3, 72, 96)
    assert torch.equal(network(images, torch.tensor([1.0])).unit, network(images, torch.tensor([1.5])).unit)


def test_a_strided_network_names_what_is_wrong_with_it():
    with pytest.raises(ValueError, match="too small"):
        StridedCNN(3, (16, 16), 4)


@pytest.mark.parametrize("name", ["resnet18", "mobilenet_v3_small", "densenet121"])
@pytest.mark.parametrize("channels", [3, 6])
def test_a_torchvision_network_gets_the_inputs_and_outputs_that_are_asked_for(name, channels):
    network = torchvision_backbone(name, channels, (64, 64), 7).eval()
    assert network(torch.rand(1, channels, 64, 64)).shape == (1, 7)


def test_further_channels_begin_at_zero_so_that_pretrained_features_are_kept():
    network = torchvision_backbone("resnet18", 6, (64, 64), 7).eval()
    images = torch.rand(1, 6, 64, 64)
    others = torch.cat([images[:, :3], torch.rand(1, 3, 64, 64)], 1)
    assert torch.equal(network(images), network(others))


def test_a_grey_image_is_seen_by_pretrained_filters_as_three_equal_colours(tmp_path):
    name, path = "mobilenet_v3_small", tmp_path / "weights.pt"
    torch.save(torchvision_classifier(name).state_dict(), path)
    grey, colour = (torchvision_backbone(name, n, (64, 64), 7, weights=str(path)).eval() for n in (1, 3))
    images = torch.rand(2, 1, 64, 64)
    torch.testing.assert_close(grey.features[0](images), colour.features[0](images.expand(2, 3, 64, 64)))


@pytest.mark.slow
def test_weights_of_a_file_are_loaded(tmp_path):
    whole = torchvision_backbone("resnet18", 3, (64, 64), 1000)
    torch.save(whole.state_dict(), tmp_path / "resnet18.pt")
    loaded = torchvision_backbone("resnet18", 3, (64, 64), 5, weights=str(tmp_path / "resnet18.pt"))
    assert torch.equal(loaded.conv1.weight, whole.conv1.weight)
    torch.save({"a": torch.zeros(2)}, tmp_path / "other.pt")
    (tmp_path / "broken.pt").write_bytes(b"no")
    for file in ("other.pt", "broken.pt", "missing.pt"):
        with pytest.raises(UserError, match=file):
            torchvision_backbone("resnet18", 3, (64, 64), 5, weights=str(tmp_path / file))


def test_an_unknown_network_is_named_with_others_like_it():
    with pytest.raises(UserError, match=r"resnet19(?s:.*)torchvision") as caught:
        torchvision_backbone("resnet19", 3, (64, 64), 5)
    assert "resnet" in str(caught.value.fix)


@pytest.mark.parametrize("name", ["mobilenetv3_small_100", "vit_tiny_patch16_224"])
def test_a_timm_network_takes_images_of_the_size_that_is_asked_for(name):
    network = timm_backbone(name, 6, (64, 96), 7).eval()
    assert network(torch.rand(1, 6, 64, 96)).shape == (1, 7)


def test_an_unknown_timm_network_is_named():
    with pytest.raises(UserError, match="convnext_nano_x"):
        timm_backbone("convnext_nano_x", 3, (64, 64), 5)
