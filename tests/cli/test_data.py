"""``sextant data``: list, render, verify."""

import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from rendered_toy import ToyPlan, contents
from support import heeds_signals

from sextant.data.rendered import open_store

ROOT = Path(__file__).parents[2]
TOY = ["dataset=digits", "dataset._target_=rendered_toy.ToyWorld", "dataset.size=22"]


@pytest.fixture
def data(run_verb, monkeypatch, tmp_path):
    """The verb, with outputs in a folder of the test's own."""
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    return partial(run_verb, "data")


def test_render_then_list_then_verify(data, tmp_path):
    assert "nothing is rendered" in data("list")[1]
    status, said = data("render", *TOY, "threads=2")
    assert status == 0
    for text in ("images", "22", "street km", "1.25", "train 20, test 2", "sun, rain", "images/s", str(tmp_path)):
        assert text in said
    open_store(ToyPlan(), tmp_path / "whole").fill()
    assert contents(tmp_path / "data") == contents(tmp_path / "whole")
    assert "all were already rendered" in data("render", *TOY)[1]
    status, said = data("list")
    assert "22/22" in said
    assert "complete" in said
    for name in ("toy", f"toy-{ToyPlan().digest[:8]}", str(tmp_path / "data" / f"toy-{ToyPlan().digest[:8]}")):
        status, said = data("verify", name)
        assert (status, "sound, 6 chunks, 22 of 22" in said) == (0, True)


def test_damage_is_named_repaired_and_rendered_again(data, tmp_path):
    data("render", *TOY)
    path = next((tmp_path / "data").glob("toy-*/image.npy"))
    before = path.read_bytes()
    path.write_bytes(before[: 128 + 90 * 9] + b"damage" + before[128 + 90 * 9 + 6 :])
    status, said = data("verify", "toy")
    assert status == 1
    assert "damaged image chunk 2: items 8 to 11" in said
    assert "repair=true" in said
    status, said = data("verify", "toy", "repair=true")
    assert status == 0
    assert "sextant data render dataset=toy" in said
    assert "18/22" in data("list")[1]
    assert data("verify", "toy")[0] == 0
    data("render", *TOY)
    assert path.read_bytes() == before


def test_a_damaged_store_is_listed_as_such(data, tmp_path):
    data("render", *TOY)
    manifest = next((tmp_path / "data").glob("toy-*/manifest.json"))
    manifest.write_text("{")
    assert "damaged: sextant data verify" in data("list")[1]
    status, said = data("render", *TOY)
    assert status == 2
    assert "the manifest cannot be read" in said
    assert data("verify", manifest.parent.name)[0] == 1
    assert data("verify", manifest.parent.name, "repair=true")[0] == 0
    assert "has no manifest" in data("list")[1]
    assert "all were already rendered" in data("render", *TOY)[1]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["burn"], "data burn: not understood"),
        (["list", "dataset=mnist"], "dataset=mnist: not understood"),
        (["render"], "dataset= is missing"),
        (["render", "dataset=mnist"], "dataset=mnist is not rendered: there is nothing to do\nRendered datasets: "),
        (["render", "dataset=mnits"], "Did you mean dataset=mnist?"),
        (["render", *TOY, "threads=none"], "threads=none must be a whole number from 1 to 256"),
        (["render", "dataset=digits", "dataset._target_=rendered_toy.Nothing"], "cannot be built"),
        (["render", *TOY, "dataset.size=0"], "no item"),
        (["render", *TOY, "paths.cache=/proc/sextant"], "/proc/sextant cannot be written to"),
        (["list", f"paths.cache={__file__}"], f"paths.cache={__file__} is not a folder"),
        (["verify", "toy", f"paths.cache={__file__}"], f"paths.cache={__file__} is not a folder"),
        (["list", "paths.cache=null"], "paths.cache=None: must be a valid string"),
        (["verify"], "name one store"),
        (["verify", "nothing"], "nothing: no store of that name"),
        (["verify", "nothing", "repair=maybe"], "repair=maybe must be true or false"),
        (["verify", "nothing", "repiar=true"], "Did you mean repair=true?"),
        (["gallery", f"folder={__file__}"], f"folder={__file__} is not a folder that can be written to"),
    ],
)
def test_mistakes(arguments, said, data):
    status, told = data(*arguments)
    assert status == 2
    assert said in told
    assert "Traceback" not in told


@pytest.mark.parametrize("arguments", [["--help"], ["render", "-h"], ["verify", "--help"]])
def test_help(arguments, data):
    status, said = data(*arguments)
    assert status == 0
    assert "sextant data verify" in said


def test_a_name_that_several_stores_share_is_told(data):
    data("render", *TOY)
    data("render", *TOY, "dataset.size=23")
    status, said = data("verify", "toy")
    assert status == 2
    assert "several stores" in said


@pytest.mark.slow
def test_ctrl_c_says_how_far_it_was_and_the_same_command_resumes(tmp_path):
    environment = {**os.environ, "SEXTANT_OUTPUTS": str(tmp_path), "PYTHONPATH": str(ROOT / "tests")}
    code = "import sys; from sextant.cli import run; run('data', sys.argv[1:])"
    command = [sys.executable, "-c", code, "render", *TOY, "dataset.size=4000", "+dataset.pause_s=0.02", "threads=2"]
    process = subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        preexec_fn=heeds_signals,
    )
    deadline = time.monotonic() + 120
    while not any(path.stat().st_size for path in tmp_path.glob("data/*/journal.jsonl")):
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert re.search(r"Interrupted: rendering [\d,]+/4,000 images. The same command resumes.\n", said)


@pytest.mark.slow
def test_nothing_heavy_is_imported(tmp_path):
    environment = {**os.environ, "SEXTANT_OUTPUTS": str(tmp_path), "PYTHONPATH": str(ROOT / "tests")}
    code = (
        "import sys; from sextant.cli import run\n"
        "run('data', sys.argv[1:])\n"
        "print(sorted({'torch', 'pytorch_lightning', 'mlflow', 'sklearn'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, "render", *TOY]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_shards_are_rendered_apart_and_put_together(data, tmp_path):
    assert data("render", *TOY, "shards=2", "shard=0")[0] == 0
    status, said = data("render", *TOY, "shards=2")
    assert (status, "shard 1 lacks 3 of 3 chunks" in said) == (2, True)
    assert data("render", *TOY, "shards=2", "shard=1")[0] == 0
    assert data("render", *TOY, "shards=2")[0] == 0
    open_store(ToyPlan(), tmp_path / "whole").fill()
    merged, whole = (next((tmp_path / folder).glob("toy-*")) for folder in ("data", "whole"))
    assert (merged / "image.npy").read_bytes() == (whole / "image.npy").read_bytes()
    for wrong, told in ((["shards=2", "shard=2"], "there are shards 0 to 1"), (["shard=1"], "shards= is missing")):
        status, said = data("render", *TOY, *wrong)
        assert status == 2
        assert told in said
