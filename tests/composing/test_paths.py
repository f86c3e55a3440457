"""Paths on the command line: taken literally where Hydra's grammar would read something else, and found again later."""

import os
from pathlib import Path

import pytest
from odd_names import ODD_NAMES

from sextant.composing.compose import compose, composing_many, to_plain
from sextant.composing.config_files import own_configs, read_config_file
from sextant.composing.overrides import literal, parse
from sextant.config import validate
from sextant.config.path_keys import PATHS, from_where_it_ran
from sextant.runs.outputs_folder import conf_dir

#: words that mean something else to Hydra when they stand alone: a quoted text, and an escaped comma
OTHERS = ("'x'", '"x"', "a\\,b", "(a", "[a", "{a", "a)", "a]", "\ttab", "^", "|", "<x>", "é\\'")


def value(override):
    (parsed,) = parse([override])
    return parsed.value


@pytest.mark.parametrize("name", [*ODD_NAMES, *OTHERS], ids=ascii)
@pytest.mark.parametrize("key", ["paths.outputs", "+dataset.folder"])
def test_a_path_is_taken_as_it_is_written(tmp_path, name, key, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(name, "inside").mkdir(parents=True)
    for path in (name, f"./{name}", str(tmp_path / name), str(tmp_path / name / "inside")):
        meant = {"'x'": "x", '"x"': "x", "a\\,b": "a,b"}.get(path, path.replace("a\\,b", "a,b"))
        assert value(f"{key}={path}") == meant
        assert literal(literal(f"{key}={path}")) == literal(f"{key}={path}")


def test_what_hydra_reads_in_a_path_is_kept():
    kept = (
        "paths.outputs=${oc.env:HOME}/x",
        "init_from=null",
        "dataset.folder='a b'",
        "dataset.folder=a,b",
        "seed=1,2",
    )
    assert [literal(override) for override in kept] == list(kept)
    (swept,) = parse(["dataset.folder=~/a,~/b"])
    assert swept.sweeps
    assert [value(f"dataset.folder={each}") for each in swept.choices()] == ["~/a", "~/b"]


def test_places_are_those_of_the_user(monkeypatch):
    monkeypatch.setenv("HOME", "/home/someone")
    found = validate(to_plain(compose(["paths.outputs=~/runs, old", "paths.data=~"]))).paths
    assert found.outputs == "/home/someone/runs, old"
    assert (found.data, found.cache) == ("/home/someone", "/home/someone/runs, old/data")


def test_own_config_files_are_found_in_folders_of_odd_names(tmp_path):
    text = (conf_dir() / "optimizer" / "sgd.yaml").read_text()
    for name in ("q?x%2F", "it's, [x]\\", "c#1 $HOME {a}", "caf\u00e9 "):
        (tmp_path / name / "optimizer").mkdir(parents=True)
        (tmp_path / name / "optimizer" / "own.yaml").write_text(text)
        with own_configs(tmp_path / name):
            assert to_plain(compose(["optimizer=own"]))["optimizer"]["_target_"] == "torch.optim.SGD"


def test_every_key_of_a_config_file_that_names_a_path_is_known():
    """``run`` and ``network`` name runs, by their directories too; ``photo`` and ``streets`` files."""
    names = {key.rpartition(".")[2] for key in PATHS}
    groups = {"dataset", "corruption", "descriptor", "features", "backbone", "local"}
    files = [path for path in conf_dir().glob("*/*.yaml") if path.parent.name in groups]
    keys = {f"{path.parent.name}.{key}" for path in files for key in read_config_file(path)}
    assert {key for key in keys if key.rpartition(".")[2] in names} - {"features.network"} <= set(PATHS)


@pytest.mark.parametrize("key", ["local.weights", "dataset.sources.real.folder"])
def test_a_path_of_any_characters_may_be_given(key):
    folder = "~/café [1]"
    found = to_plain(compose(["task=place_recognition", "local=aliked", f"local.weights={folder}"]))
    if key.startswith("dataset"):
        found = to_plain(compose(["task=calibration", "dataset=panorama_mix", f"{key}={folder}"]))
    value = found
    for part in key.split("."):
        value = value[part]
    assert value == folder


def test_a_stored_run_finds_the_files_it_was_given_from_any_folder(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "imagenet").mkdir()
    (tmp_path / "weights.pth").touch()
    stored = {
        "dataset": {"folder": "imagenet", "size": 32},
        "task": {"off_the_shelf": {"weights": "weights.pth"}},
        "corruption": {"folder": str(tmp_path)},
        "backbone": {"weights": "imagenet"},
        "descriptor": {"folder": "nowhere", "run": None, "photo": "~/x"},
        "paths": {"here": str(tmp_path), "outputs": "photos"},
        "init_from": None,
    }
    found = from_where_it_ran(stored)
    assert found["dataset"] == {"folder": str(tmp_path / "imagenet"), "size": 32}
    assert found["task"]["off_the_shelf"]["weights"] == str(tmp_path / "weights.pth")
    unchanged = ("corruption", "descriptor", "backbone", "paths")
    assert {key: found[key] for key in unchanged} == {key: stored[key] for key in unchanged}
    assert stored["dataset"]["folder"] == "imagenet"
    assert from_where_it_ran({**stored, "paths": {}}) == {**stored, "paths": {}}


def test_the_folder_of_a_run_is_kept_with_it_and_changes_no_digest(tmp_path, monkeypatch):
    from sextant.config import digest

    with composing_many():
        monkeypatch.chdir(tmp_path)
        there = to_plain(compose([]))
        monkeypatch.chdir("/")
        here = to_plain(compose([]))
    assert (there["paths"]["here"], here["paths"]["here"]) == (os.fspath(tmp_path), "/")
    assert digest(there) == digest(here) == digest({**here, "paths": {}})
