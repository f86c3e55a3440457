import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from localization.observation.smooth_map import KERNEL, descriptors_at, poses_in_room, smooth_map

from sextant.atomic_files import write_sealed_json
from sextant.errors import ArgumentError, UserError
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.local_gp import LocalGP
from sextant.localization.saved_map import HEADER, load_map, save_map

LIKELIHOOD = Likelihood("student", tempering=0.25, appearance_variance=0.01, dof=5.0)
FACTS = {"descriptor": {"name": "whitened_pca", "run": "abc"}, "images": 240}
MODELS = [ExactGP(max_images=500), LocalGP(8, "nearest_image"), CachedLocalGP(12, blend=2, map_evidence="mean")]


@pytest.fixture
def folder(tmp_path):
    save_map(tmp_path / "map", CachedLocalGP(8).fit(smooth_map(), KERNEL), LIKELIHOOD, FACTS)
    return tmp_path / "map"


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
@pytest.mark.parametrize("verify", [True, False])
def test_a_loaded_map_is_the_one_that_was_saved(tmp_path, model, verify):
    save_map(tmp_path, model.fit(smooth_map(), KERNEL), LIKELIHOOD, FACTS)
    loaded = load_map(tmp_path, verify=verify)
    assert type(loaded.model) is type(model)
    assert loaded.model.arguments() == model.arguments()
    assert loaded.model.kernel == KERNEL
    assert loaded.likelihood == LIKELIHOOD
    assert loaded.facts == FACTS
    poses, images = poses_in_room(40, seed=1), descriptors_at(poses_in_room(1, seed=2), 6)
    told = [m.observe(images, LIKELIHOOD) for m in (loaded.model, model)]
    assert torch.equal(told[0].log_likelihood(poses[None]), told[1].log_likelihood(poses[None]))
    assert torch.equal(told[0].over_map(), told[1].over_map())
    assert torch.equal(loaded.model.predict(poses).mean, model.predict(poses).mean)


def test_large_arrays_are_mapped_and_what_is_written_into_them_does_not_reach_the_file(folder, monkeypatch):
    monkeypatch.setattr("sextant.localization.saved_map.SMALL", 0)
    model = load_map(folder).model
    mapped = {Path(part.path) for part in psutil.Process().memory_maps()}
    assert {folder / "descriptors.npy", folder / "state/grams.npy"} <= mapped
    model.caches.grams[:] = 0
    load_map(folder)  # its hashes still hold


def test_a_map_can_be_saved_over_itself(folder):
    loaded = load_map(folder)
    save_map(folder, loaded.model, loaded.likelihood, {"again": True})
    again, poses = load_map(folder), poses_in_room(5)
    assert again.facts == {"again": True}
    assert torch.equal(again.model.predict(poses).mean, CachedLocalGP(8).fit(smooth_map(), KERNEL).predict(poses).mean)


def test_a_fact_that_json_cannot_hold_keeps_the_former_map(folder):
    loaded = load_map(folder)
    with pytest.raises(ArgumentError, match="of=<object") as error:
        save_map(folder, loaded.model, loaded.likelihood, {"images": 3, "of": object()})
    assert "\n" not in error.value.problem
    assert load_map(folder).facts == FACTS


def test_numbers_of_numpy_are_written_as_plain_ones(tmp_path):
    model = CachedLocalGP(np.int64(8)).fit(smooth_map(), KERNEL)
    save_map(tmp_path, model, Likelihood(tempering=np.float32(0.5)), {"size": np.arange(2), "share": np.float32(0.25)})
    loaded = load_map(tmp_path)
    assert (loaded.model.neighbours, loaded.likelihood.tempering) == (8, 0.5)
    assert loaded.facts == {"size": [0, 1], "share": 0.25}


def test_no_file_can_be_unpickled(folder):
    for path in folder.rglob("*.npy"):
        np.load(path, allow_pickle=False)
    assert {path.suffix for path in folder.rglob("*") if path.is_file()} == {".npy", ".json"}


@pytest.mark.parametrize("name", ["poses", "descriptors", "mean", "state/grams", "state/neighbours"])
@pytest.mark.parametrize("damage", ["flipped", "cut", "missing", "empty"])
def test_a_damaged_file_is_named(folder, name, damage):
    path = folder / f"{name}.npy"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    damaged = {"flipped": bytes(content), "cut": bytes(content[:-7]), "empty": b""}
    path.unlink()
    if damage != "missing":
        path.write_bytes(damaged[damage])
    with pytest.raises(UserError, match=rf"{name}\.npy"):
        load_map(folder)


def test_a_cut_file_is_found_without_hashes(folder):
    path = folder / "descriptors.npy"
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(UserError, match=r"descriptors\.npy has \d+ bytes"):
        load_map(folder, verify=False)


def _with(folder, change):
    header = json.loads((folder / HEADER).read_text())
    change(header)
    write_sealed_json(folder / HEADER, header)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda header: header.update(version=2), "version 2; this program reads version 1"),
        (lambda header: header.update(format="other"), "not the header of a map"),
        (lambda header: header.pop("kernel"), "lacks keys"),
        (lambda header: header["model"].update({"class": "os.system"}), "os.system"),
        (lambda header: header["model"]["arguments"].update(neighbours=9), "whiteners|neighbours"),
        (lambda header: header["model"]["arguments"].update(made_up=9), "made_up"),
        (lambda header: header["kernel"].update(noise_variance=-1), "noise_variance=-1"),
        (lambda header: header["likelihood"].update(form="made_up"), "made_up"),
        (lambda header: header["files"].pop("state/grams"), "grams"),
        (lambda header: header["files"].pop("descriptors"), "descriptors"),
        (lambda header: header["files"].update({"../elsewhere": {"bytes": 1}}), "elsewhere"),
    ],
)
def test_a_header_that_is_wrong_is_refused_and_says_how(folder, change, told):
    _with(folder, change)
    with pytest.raises(UserError, match=told):
        load_map(folder)


@pytest.mark.parametrize("content", ["", "[]", "{", "null"])
def test_a_header_that_is_none_is_refused(folder, content):
    (folder / HEADER).write_text(content)
    with pytest.raises(UserError, match=r"map\.json is not the header of a map"):
        load_map(folder)


def test_a_folder_without_a_map_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"the folder has no map\.json"):
        load_map(tmp_path)
    with pytest.raises(UserError, match="no such folder"):
        load_map(tmp_path / "nowhere")


@pytest.mark.parametrize("old", ["0.25", "5.0", '"student"', '"abc"'])
def test_an_altered_header_is_told(folder, old):
    path = folder / HEADER
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, old.replace("5", "7").replace("u", "v").replace("c", "d"), 1))
    with pytest.raises(UserError, match=r"map\.json was altered"):
        load_map(folder)


def test_a_map_from_before_headers_had_a_hash_opens(folder):
    header = json.loads((folder / HEADER).read_text())
    del header["seal"]
    (folder / HEADER).write_text(json.dumps(header))
    assert load_map(folder).facts == FACTS


@given(
    flips=st.lists(st.tuples(st.integers(0, 2**30), st.integers(1, 255)), min_size=1, max_size=9), which=st.integers()
)
def test_a_map_with_flipped_bytes_is_refused_or_the_same(whole_map, flips, which):
    folder, contents, answer = whole_map
    path = sorted(contents)[which % len(contents)]
    content = bytearray(contents[path])
    for position, change in flips:
        content[position % len(content)] ^= change
    path.write_bytes(content)
    try:
        with suppress(UserError):
            assert answers(folder) == answer
    finally:
        path.write_bytes(contents[path])


def answers(folder):
    found = load_map(folder)
    mean = found.model.predict(poses_in_room(5)).mean
    return found.facts, found.likelihood, found.model.kernel, found.model.arguments(), mean.tolist()


@pytest.fixture(scope="module")
def whole_map(tmp_path_factory):
    """A folder, what is in its files, and what the map in it answers."""
    folder = tmp_path_factory.mktemp("maps") / "map"
    save_map(folder, CachedLocalGP(8).fit(smooth_map(), KERNEL), LIKELIHOOD, FACTS)
    return folder, {path: path.read_bytes() for path in folder.rglob("*.*")}, answers(folder)


def test_a_map_whose_saving_was_broken_off_is_not_taken_for_one(folder, monkeypatch):
    monkeypatch.setattr("sextant.array_folder.write_sealed_json", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        save_map(folder, ExactGP().fit(smooth_map(), KERNEL), LIKELIHOOD, FACTS)
    with pytest.raises(UserError, match=r"no map\.json"):
        load_map(folder)


class OwnGP(LocalGP):
    """A model of the user's own."""


def test_a_map_with_a_model_of_ones_own_opens_for_those_who_trust_it(tmp_path):
    model = OwnGP(8).fit(smooth_map(), KERNEL)
    save_map(tmp_path, model, LIKELIHOOD, FACTS)
    with pytest.raises(UserError, match=r"needs .*OwnGP.*\n.*trust=true"):
        load_map(tmp_path)
    assert type(load_map(tmp_path, trust=True).model) is OwnGP


@pytest.mark.parametrize("path", ["os.system", "subprocess.Popen", "sextant.errors.UserError", "gone.Model", "os.gone"])
def test_what_is_no_model_is_refused_even_then(folder, path):
    _with(folder, lambda header: header["model"].update({"class": path}))
    with pytest.raises(UserError, match="do not make a map"):
        load_map(folder, trust=True)
