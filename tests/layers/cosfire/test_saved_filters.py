"""Filters in files: what was saved comes back, and nothing else does."""

import json
from dataclasses import dataclass

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import MEANS, Given, layers, random_images
from safetensors.torch import load_file, save_file
from torch import nn

from sextant.errors import UserError
from sextant.layers.cosfire import (
    Blur,
    ChannelPeaks,
    Cosfire,
    DoGBank,
    FeatureBank,
    Tolerance,
    VectorBank,
    VectorKeypoints,
    preset,
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "filters.safetensors"


def corner():
    image = torch.zeros(1, 41, 41, dtype=torch.float64)
    image[:, :21, 20:] = 1
    return image


@given(layers(means=MEANS), st.integers(0, 9))
@settings(max_examples=15)
def test_what_was_saved_comes_back_with_all_options(tmp_path_factory, case, seed):
    layer, _ = case
    layer.strategy = ChannelPeaks(reach=3.0)
    path = tmp_path_factory.mktemp("filters") / "a.safetensors"
    layer.save(path)
    twin = Cosfire.load(path)
    images = random_images(seed, 1, 1, 9, 9)
    assert torch.equal(twin(images), layer(images))
    for name in ("strategy", "blur", "tolerance"):
        assert getattr(twin, name) == getattr(layer, name)
    assert twin.options() == layer.options()
    assert twin.bank.options() == layer.bank.options()


@pytest.mark.parametrize("name", ["bifurcation", "digit", "vessel_end_drive"])
def test_a_preset_goes_on_being_configured(path, name):
    layer = preset(name).configure(corner())
    layer.save(path)
    twin = Cosfire.load(path)
    for filters in (layer, twin):
        filters.configure(corner().flip(-1), (21, 20))
    assert torch.equal(twin.phi, layer.phi)
    assert len(twin) == 2


def test_a_layer_without_filters_can_be_saved(path):
    preset("digit").save(path)
    assert len(Cosfire.load(path)) == 0


def test_trained_filters_come_back(path):
    layer = preset("digit").configure(corner()).train_parts()
    layer.weights.data *= torch.linspace(0.5, 2.0, len(layer.weights))
    layer.save(path)
    torch.testing.assert_close(Cosfire.load(path)(corner()[None]), layer(corner()[None]).detach())


@pytest.mark.parametrize("kind", [FeatureBank, VectorBank])
def test_filters_over_a_network_need_it(path, kind):
    network = nn.Conv2d(3, 6, 3, dtype=torch.float64)
    layer = Cosfire(kind(network, 6), VectorKeypoints() if kind is VectorBank else ChannelPeaks(t2=0.5), floor=0.01)
    layer.configure(random_images(0, 3, 15, 15)).save(path)
    assert not any("bank" in name for name in load_file(path))
    images = random_images(1, 2, 3, 12, 10)
    assert torch.equal(Cosfire.load(path, kind(network, 6))(images), layer(images))
    with pytest.raises(UserError, match=rf"use a {kind.__name__}, whose network is not in the file"):
        Cosfire.load(path)
    with pytest.raises(UserError, match=rf"made for a {kind.__name__} of 6 channels, not for a {kind.__name__} of 4"):
        Cosfire.load(path, kind(network, 4))
    with pytest.raises(UserError, match=rf"made for a {kind.__name__} of 6 channels, not for a DoGBank of 1"):
        Cosfire.load(path, DoGBank())


def test_a_strategy_of_the_users_own_cannot_be_saved(path):
    @dataclass(frozen=True)
    class ConcentricCircles(Given):
        """Of the same name as one of ours."""

    with pytest.raises(UserError, match="strategy ConcentricCircles cannot be saved"):
        Cosfire(DoGBank(), ConcentricCircles(())).save(path)
    assert not path.exists()


def test_a_file_that_is_not_there_is_told(path):
    with pytest.raises(UserError, match="there is no file"):
        Cosfire.load(path)


@pytest.mark.parametrize("content", [b"", b"no tensors", b"\x80\x04K\x01.", bytes(64)])
def test_a_file_of_something_else_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(UserError, match="cannot be read as COSFIRE filters"):
        Cosfire.load(path)
    save_file({"weight": torch.zeros(3)}, path)
    with pytest.raises(UserError, match="not one of filters"):
        Cosfire.load(path)
    with pytest.raises(UserError, match="cannot be read as COSFIRE filters"):
        Cosfire.load(path.parent)


@given(cut=st.floats(0.0, 0.99))
def test_a_file_that_is_cut_off_is_refused(tmp_path_factory, cut):
    path = tmp_path_factory.mktemp("filters") / "a.safetensors"
    preset("digit").configure(corner()).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(UserError, match="cannot be read as COSFIRE filters"):
        Cosfire.load(path)


@given(flips=st.lists(st.tuples(st.integers(0, 2**30), st.integers(1, 255)), min_size=1, max_size=50))
def test_a_file_with_flipped_bytes_is_refused(tmp_path_factory, flips):
    path = tmp_path_factory.mktemp("filters") / "a.safetensors"
    preset("digit").configure(corner()).save(path)
    whole = path.read_bytes()
    content = bytearray(whole)
    for position, change in flips:
        content[position % len(content)] ^= change
    if content == whole:
        return
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"a\.safetensors cannot be read as COSFIRE filters"):
        Cosfire.load(path)


def test_filters_from_before_files_had_a_digest_are_read(path):
    layer = preset("digit").configure(corner())
    layer.save(path)
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        metadata = {"sextant.cosfire": file.metadata()["sextant.cosfire"]}
    save_file(load_file(path), path, metadata)
    assert torch.equal(Cosfire.load(path)(corner()[None]), layer(corner()[None]))


def changed(header, *keys, value):
    inner = header
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value


HEADERS = [
    (("version",), 1),
    (("bank", "class"), "os"),
    (("bank", "options", "wavelengths"), [1.0]),
    (("bank", "options"), {"command": "rm"}),
    (("strategy", "class"), "Path"),
    (("strategy", "options", "radii"), 3),
    (("blur",), None),
    (("tolerance", "rotations"), "many"),
    (("numbers", "mean"), "mode"),
    (("grid",), [3]),
]


@pytest.mark.parametrize(("keys", "value"), HEADERS)
def test_a_header_that_was_changed_is_refused(path, keys, value):
    preset("digit").configure(corner()).save(path)
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        header = json.loads(file.metadata()["sextant.cosfire"])
    changed(header, *keys, value=value)
    save_file(load_file(path), path, {"sextant.cosfire": json.dumps(header)})
    with pytest.raises(UserError):
        Cosfire.load(path)


ARRAYS = {
    "missing": lambda arrays: arrays.pop("phi"),
    "too many": lambda arrays: arrays.update(more=arrays["rho"].clone()),
    "shorter": lambda arrays: arrays.update(phi=arrays["phi"][1:].clone()),
    "out of order": lambda arrays: arrays["form"][:1].add_(1),
    "of no filter": lambda arrays: arrays.update(filter_of_form=arrays["filter_of_form"][:0].clone()),
    "not finite": lambda arrays: arrays.update(rho=arrays["rho"] / 0),
    "of another bank": lambda arrays: arrays.update(channels=torch.zeros(len(arrays["rho"]), 5)),
    "no integers": lambda arrays: arrays.update(form=arrays["form"].double()),
}


@pytest.mark.parametrize("change", ARRAYS)
def test_arrays_that_were_changed_are_refused(path, change):
    preset("digit").configure(corner()).save(path)
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        metadata = {"sextant.cosfire": file.metadata()["sextant.cosfire"]}  # without the digest, which would tell
    arrays = load_file(path)
    ARRAYS[change](arrays)
    save_file(arrays, path, metadata)
    with pytest.raises(UserError, match="cannot be read as COSFIRE filters"):
        Cosfire.load(path)


def test_tuples_of_options_are_tuples_again(path):
    layer = Cosfire(DoGBank((1.0, 2.0), (1, -1)), tolerance=Tolerance(scales=(1.0, 2.0)), blur=Blur(fixed_reach=2))
    layer.save(path)
    twin = Cosfire.load(path)
    assert (twin.tolerance, twin.blur) == (layer.tolerance, layer.blur)
    assert twin.bank.sigmas == (1.0, 2.0)
