"""What choosing an option does, for those that no experiment and no other test chooses."""

import numpy as np
import pytest
import torch
from data.localization.drives import circle

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.building import build
from sextant.geometry import Parameterization, ParameterSpace
from sextant.kit.assemble import build_dataset
from sextant.layers import BlurPool2d, PushPullAvgConv2d, PushPullConv2d, inhibited
from sextant.models import ResNetCifar


def option(choice, *needed, **arguments):
    """What an option of a group builds."""
    raw = to_plain(compose([choice, *needed]))
    validate(raw)
    return build(raw, choice.partition("=")[0], **arguments)


#: parameters with ten classes
CIFAR = {
    "resnet32": 466_906,
    "resnet44": 661_338,
    "resnet56": 855_770,
    "densenet_100_12": 769_162,
    "densenet_100_24": 2_936_650,
    "alexnet_cifar": 23_272_266,
}
#: with a thousand
IMAGENET = {"resnet18": 11_689_512, "resnet50": 25_557_032, "mobilenet_v3_small": 2_542_856}


@pytest.mark.parametrize(("name", "parameters"), CIFAR.items())
def test_a_network_for_cifar_has_the_published_size(name, parameters):
    network = option(f"backbone={name}", in_channels=3, image_size=(32, 32), num_classes=10)
    assert sum(p.numel() for p in network.parameters()) == parameters


@pytest.mark.parametrize(("name", "parameters"), IMAGENET.items())
def test_a_network_of_torchvision_has_the_published_size(name, parameters):
    network = option(f"backbone={name}", in_channels=3, image_size=(224, 224), num_classes=1000)
    assert sum(p.numel() for p in network.parameters()) == parameters


def test_caffenet_has_the_convolutions_of_alexnet_in_two_groups():
    network = option("backbone=caffenet", in_channels=3, image_size=(227, 227), num_classes=10)
    convs = [m for m in network.modules() if isinstance(m, torch.nn.Conv2d)]
    assert [(c.out_channels, c.kernel_size[0], c.groups) for c in convs] == [
        *((96, 11, 1), (256, 5, 2), (384, 3, 1), (384, 3, 2), (256, 3, 2)),
    ]


def test_timm_gives_the_network_of_the_name_that_is_written():
    pytest.importorskip("timm")
    network = option("backbone=timm", "backbone.name=resnet10t", in_channels=1, image_size=(64, 64), num_classes=7)
    assert network(torch.zeros(2, 1, 64, 64)).shape == (2, 7)


@pytest.mark.parametrize(
    ("name", "layer", "paths"),
    [
        ("first_block", PushPullConv2d, [f"layer1.{i}.conv{j}" for i in range(3) for j in (1, 2)]),
        ("push_pull_avg", PushPullAvgConv2d, ["conv1"]),
        ("push_pull_trained", PushPullConv2d, ["conv1"]),
    ],
)
def test_inhibition_stands_where_the_option_says(name, layer, paths):
    network = option(f"inhibition={name}")(ResNetCifar(3, (32, 32), 10, depth=20))
    assert inhibited(network) == paths
    assert all(type(network.get_submodule(path)) is layer for path in paths)
    trained = isinstance(network.get_submodule(paths[0]).alpha, torch.nn.Parameter)
    assert trained == (name == "push_pull_trained")


def test_anti_aliasing_blurs_wherever_a_resnet_subsamples():
    network = option("inhibition=anti_aliasing", "inhibition.taps=5")(ResNetCifar(3, (32, 32), 10, depth=20))
    blurs = [module for module in network.modules() if isinstance(module, BlurPool2d)]
    assert blurs
    assert {blur.taps for blur in blurs} == {5}
    assert network(torch.zeros(1, 3, 32, 32)).shape == (1, 10)


def test_perturbations_can_be_chosen_by_name():
    suite = option("corruption=cifar10_p", "corruption.names=[rotate,translate]")
    assert {condition.corruption for condition in suite.conditions()} == {None, "rotate", "translate"}


def test_augmix_mixes_every_image_in_its_own_way_and_repeats_it():
    augmentation = option("augmentation=augmix")
    images = torch.randint(0, 256, (1, 3, 32, 32), dtype=torch.uint8).expand(4, -1, -1, -1).contiguous()
    first, again, later = (augmentation(images, torch.arange(4), epoch, 0) for epoch in (0, 0, 1))
    assert torch.equal(first, again)
    assert len({image.numpy().tobytes() for image in (*first, *later)}) == 8


def test_fashion_mnist_has_ten_kinds_of_clothing():
    raw = to_plain(compose(["dataset=fashion_mnist"]))
    spec = build_dataset(validate(raw)).spec()
    assert (spec.channels, spec.height, spec.width) == (1, 28, 28)
    assert spec.classes[-1] == "ankle boot"


def test_descriptors_of_localization_do_not_see_the_light_they_are_made_not_to_see():
    images = np.random.default_rng(0).integers(20, 120, (3, 32, 48, 3)).astype(np.uint8)
    for name in ("hog", "patch_normalised"):
        kind = option(f"descriptor={name}", "task=localization")
        plain, bright = kind.describe(images), kind.describe(2 * images)
        cosine = (plain * bright).sum(1) / np.linalg.norm(plain, axis=1) / np.linalg.norm(bright, axis=1)
        np.testing.assert_allclose(cosine, 1, atol=1e-3)


def test_faults_put_into_a_drive_what_their_options_say():
    drive, rng = circle(40), np.random.default_rng(0)

    def under(name):
        return option(f"fault={name}", "task=localization").drive(drive, rng)

    assert 10 < under("dropped_frames").seen.sum() < 30
    assert np.isnan(under("missing_odometry").motion).any(axis=1).nonzero()[0].tolist() == list(range(20, 30))
    np.testing.assert_allclose(under("odometry_scale").motion, drive.motion * [1.1, 1.1, 1.0])


def test_the_published_motion_errs_as_much_standing_as_driving():
    motion = option("motion=published", "task=localization")
    poses, moves = torch.zeros(2, 20_000, 3, dtype=torch.float64), torch.tensor([[0.0, 0, 0], [3, 0, 0]]).double()
    moved = motion.sample(poses, moves, torch.Generator().manual_seed(0))
    torch.testing.assert_close(moved.std(1)[0], torch.tensor([0.025, 0.01, 0.015]).double(), rtol=0.03, atol=0)
    torch.testing.assert_close(moved.std(1)[1, [0, 2]], moved.std(1)[0, [0, 2]], rtol=0.03, atol=0)


def test_huber_is_linear_beyond_a_tenth_of_the_range():
    low, high = torch.tensor([-0.5, -0.5, 0.5, -1.0]), torch.tensor([0.5, 0.5, 2.5, 0.0])
    loss = option("loss=huber", "task=calibration", space=ParameterSpace(Parameterization(), low, high))
    truth = torch.zeros(3, 4)
    off = truth + torch.tensor([0.05, 0.5, 0.6])[:, None] * (high - low)
    near, far, farther = loss(off, truth, torch.ones(3))
    assert float(near) == pytest.approx(0.05**2)
    assert float(farther - far) == pytest.approx(2 * 0.1 * 0.1, rel=1e-4)


def test_the_cameras_of_geocalib_are_those_of_its_paper():
    cameras = option("sampling=geocalib", "task=calibration").draw(4000, 0).cameras
    tilt, roll = torch.rad2deg(cameras.tilt), torch.rad2deg(cameras.roll)
    for angle in (tilt, roll):
        assert -45 <= float(angle.min()) < -43
        assert 43 < float(angle.max()) <= 45
    fov = torch.rad2deg(2 * torch.atan(1 / (2 * cameras.focal)))
    assert 20 <= float(fov.min()) < 22
    assert 103 < float(fov.max()) <= 105
    apparent = cameras.k1 / cameras.focal**2
    assert float(apparent.abs().max()) <= 0.3
    assert float(apparent.std()) == pytest.approx(0.07, rel=0.1)
