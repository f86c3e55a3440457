"""The published sets: names, rows, choices, and the protocol that a suite carries."""

import pytest
import torch

from sextant.config.building import build
from sextant.corruptions import (
    BenchmarkSuite,
    Condition,
    GaussianNoise,
    benchmark_set,
    cifar10_c,
    eight_bit,
    imagenet_c,
    mnist_c,
)
from sextant.errors import UserError

FIFTEEN = [
    "gaussian_noise",
    "shot_noise",
    "impulse_noise",
    "defocus_blur",
    "glass_blur",
    "motion_blur",
    "zoom_blur",
    "snow",
    "frost",
    "fog",
    "brightness",
    "contrast",
    "elastic_transform",
    "pixelate",
    "jpeg_compression",
]
FOUR = ["speckle_noise", "gaussian_blur", "spatter", "saturate"]
MNIST = [
    "shot_noise",
    "impulse_noise",
    "glass_blur",
    "motion_blur",
    "shear",
    "scale",
    "rotate",
    "brightness",
    "translate",
    "stripe",
    "fog",
    "spatter",
    "dotted_line",
    "zigzag",
    "canny_edges",
]
IMAGES, INDICES = torch.rand(3, 3, 32, 32), torch.arange(3)


@pytest.mark.parametrize("build", [cifar10_c, imagenet_c])
def test_the_sets_have_their_corruptions_in_the_published_order(build):
    assert list(build()) == FIFTEEN + FOUR
    assert list(build("benchmark15")) == FIFTEEN
    assert list(build("extra4")) == FOUR
    assert list(build(["saturate", "fog", "gaussian_noise"])) == ["gaussian_noise", "fog", "saturate"]
    assert list(build(["extra4", "fog"])) == ["fog", *FOUR]
    assert all(c.name == name and tuple(c.levels) == (1, 2, 3, 4, 5) for name, c in build().items())


def test_mnist_c_has_one_severity_of_each_corruption():
    chosen = mnist_c()
    assert list(chosen) == MNIST
    published = {"shot_noise": 5, "impulse_noise": 4, "shear": 2, "scale": 3, "rotate": 2, "brightness": 5}
    published |= {"translate": 3, "fog": 5, "spatter": 4}
    assert {name: c.levels for name, c in chosen.items()} == {name: (published.get(name, 1),) for name in MNIST}


def test_severities_may_be_chosen_and_those_without_any_stay():
    chosen = mnist_c(["shear", "stripe"], severities=[5, 2])
    assert {name: tuple(c.levels) for name, c in chosen.items()} == {"shear": (2, 5), "stripe": (1,)}


def test_every_table_has_five_rows_or_is_of_a_corruption_without_severities():
    for key in ("cifar10_c", "cifar100_c", "imagenet_c", "mnist_c"):
        assert {len(f.table) for f in benchmark_set(key).families.values()} <= {1, 5}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"set": "cifar_c"}, "set='cifar_c' must be one of cifar10_c, cifar100_c, mnist_c, imagenet_c"),
        (
            {"names": ["fog", "rain"]},
            "names=rain is not in the set cifar10_c\nIt has: benchmark15, extra4, ga",
        ),
        ({"names": []}, "chooses no corruption"),
        ({"severities": [1, 6]}, r"severities=\[1,6\] has to be a list of some of 1, 2, 3, 4, 5"),
        ({"severities": [2, 2]}, "each once"),
        ({"severities": []}, "has to be a list"),
        ({"mode": "exact"}, "mode='exact' must be one of faithful, corrected"),
    ],
)
def test_choices_that_do_not_exist_are_told(arguments, says):
    with pytest.raises(UserError, match=says):
        BenchmarkSuite(**arguments)


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_a_suite_shows_images_as_the_files_hold_them(mode):
    suite = BenchmarkSuite(names=["contrast", "gaussian_noise"], severities=[2], mode=mode, seed=5)
    assert [c.key for c in suite.conditions()] == ["clean", "gaussian_noise/2", "contrast/2"]
    assert suite.corrupt(IMAGES, INDICES, Condition()) is IMAGES
    for condition in suite.conditions()[1:]:
        raw = suite.corruptions[condition.corruption](IMAGES, 2, INDICES, 5)
        assert torch.equal(suite.corrupt(IMAGES, INDICES, condition), eight_bit(raw, mode))


def test_rounding_can_be_left_out():
    suite = BenchmarkSuite(names=["contrast"], quantise=False)
    raw = suite.corruptions["contrast"](IMAGES, 2, INDICES, 0)
    assert torch.equal(suite.corrupt(IMAGES, INDICES, Condition("contrast", 2)), raw)
    assert suite.protocol.rounding == "none"


def test_a_suite_carries_its_protocol():
    protocol = BenchmarkSuite("mnist_c", ["fog", "stripe"], mode="corrected", seed=3).protocol.as_dict()
    assert protocol == {
        "set": "mnist_c",
        "title": "MNIST-C (Mu & Gilmer 2019)",
        "severities": {"stripe": (1,), "fog": (5,)},
        "mode": "corrected",
        "rounding": "8 bits, to the nearest",
        "baseline": "none; plain errors",
        "image_size": 28,
        "seed": 3,
    }


def test_pushpulls_suites_are_what_they_were():
    from sextant.corruptions import CorruptionSuite, GaussianNoise

    suite = CorruptionSuite({"gaussian": GaussianNoise([0.1])}, seed=0)
    noisy = suite.corrupt(torch.zeros(1, 1, 2, 2), torch.tensor([0]), Condition("gaussian", 0.1))
    generator = torch.Generator().manual_seed(455431443850761395)
    expected = torch.empty(1, 2, 2).normal_(std=0.1**0.5, generator=generator)
    assert torch.equal(noisy[0], expected)


def test_a_config_names_the_key_of_a_choice_that_does_not_exist():
    node = {"_target_": "sextant.corruptions.BenchmarkSuite", "names": ["rain"]}
    with pytest.raises(UserError, match=r"^corruption.names=rain is not in the set"):
        build({"corruption": node}, "corruption")


def test_corruptions_beside_a_set_are_not_rounded_and_not_of_its_protocol():
    noise = GaussianNoise([0.1, 0.5], clip=False)
    suite = BenchmarkSuite("cifar10_c", ["fog"], [1, 5], beside={"gaussian": noise})
    alone = BenchmarkSuite("cifar10_c", ["fog"], [1, 5])
    assert [c.key for c in suite.conditions()] == ["clean", "fog/1", "fog/5", "gaussian/0.1", "gaussian/0.5"]
    assert suite.protocol == alone.protocol
    for condition in alone.conditions():
        assert torch.equal(suite.corrupt(IMAGES, INDICES, condition), alone.corrupt(IMAGES, INDICES, condition))
    found = suite.corrupt(IMAGES, INDICES, Condition("gaussian", 0.5))
    assert torch.equal(found, noise(IMAGES, 0.5, INDICES, 0))
    assert found.min() < 0
    with pytest.raises(UserError, match=r"beside=fog: CIFAR-10-C .* has that name"):
        BenchmarkSuite("cifar10_c", ["snow"], beside={"fog": noise})
