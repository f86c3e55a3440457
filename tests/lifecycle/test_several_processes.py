"""One run in two processes: what one finds at the same batch, resumed after kills, refused where it cannot be."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from calibration_toy import ToyPanoramas
from PIL import Image
from support import CHECKPOINT, QUICK, quick_config, wait_for
from tiny_places import ride

from sextant.composing.compose import compose, to_plain
from sextant.config import digest
from sextant.errors import LossNotFiniteError, UserError
from sextant.lifecycle.execute import execute
from sextant.lifecycle.sweep import run_sweep
from sextant.runs.checkpoint import load_checkpoint
from sextant.runs.directory import RunDirectory, all_runs
from sextant.runs.history import read_history

ROOT = Path(__file__).parents[2]
USUAL = ("trainer.max_epochs=3", "trainer.log_every=20", "trainer.progress=false", "tracking=none", "corruption=none")
TWO = "trainer.devices=2"


def classification(folder):
    """With batch normalisation, a schedule, augmentation and a last batch of an odd number of images."""
    return [
        "backbone=small_vgg",
        "backbone.widths=[8,16]",
        "backbone.depths=[1,1]",
        "trainer.batch_size=63",
        "optimizer.lr=1e-3",
    ]


def calibration(folder):
    """Crops drawn anew in every epoch, 42 in batches of 16."""
    (folder / "panoramas").mkdir()
    for split in ("train", "val", "test"):
        for number, panorama in enumerate(ToyPanoramas().read(split)):
            Image.fromarray(panorama).save(folder / "panoramas" / f"{split}{number}.png")
    return [
        "task=calibration", "dataset=panorama_folder", f"dataset.folder={folder}/panoramas", "dataset.height=64",
        "dataset.fractions={train: 0.6, val: 0.2, test: 0.2}", "task.width=32", "task.height=24", "task.augment=true",
        "task.crops_per_panorama={train: 4, val: 2, test: 2}", "backbone=strided_cnn", "backbone.widths=[8,8]",
        "trainer.batch_size=15", "trainer.eval_batch_size=64", "trainer.workers=0",
    ]  # fmt: skip


def places(folder):
    """Batches of five images of each of three conditions, an odd number of them in all."""
    for split, first in (("train", 0), ("val", 100), ("test", 200)):
        for number, condition in enumerate(("a", "b", "c")):
            name = "{k:03d}.jpg" if condition == "c" else "{k:03d}.png"
            ride(folder / split / condition, range(first, first + 25), night=number > 0, name=name)
    shown = {split: ", ".join(f"{c}: {split}/{c}" for c in "abc") for split in ("train", "val", "test")}
    splits = [f"dataset.{split}={{{folders}}}" for split, folders in shown.items()]
    return [
        "task=place_recognition", "dataset=place_folders", f"dataset.folder={folder}", "dataset.places=name", *splits,
        "dataset.height=32", "dataset.width=48", "pooling.grid=null", "task.dimension=16", "task.batch_places=5",
        "task.batch_conditions=3", "task.baselines=false", "task.whitening=null", "backbone.widths=[8,8]",
    ]  # fmt: skip


def mined_places(folder):
    """Triplets of the whole training set."""
    return [*places(folder), "loss=triplet_margin", "mining=cached_hard"]


def run(folder, *words):
    outcome = execute(to_plain(compose([*USUAL, f"paths.outputs={folder}/outputs", *words])))
    return RunDirectory(outcome.directory)


def losses(directory):
    lines = read_history(directory.history)
    return {line["step"]: line["metrics"]["train/loss"] for line in lines if "train/loss" in line["metrics"]}


@pytest.mark.slow
@pytest.mark.parametrize("task", [classification, calibration, mined_places])
def test_two_processes_find_what_one_finds(tmp_path, task):
    """Places without mining are left out: the same step gathers descriptors of triplets and of other batches."""
    words = task(tmp_path)
    one, two = run(tmp_path, *words), run(tmp_path, *words, TWO)
    assert one.path != two.path
    expected, found = losses(one), losses(two)
    assert found.keys() == expected.keys()
    assert len(found) >= 3
    assert found == pytest.approx(expected, rel=2e-3)
    first = min(expected)
    assert found[first] == pytest.approx(expected[first], rel=1e-5)
    expected, found = one.results(), two.results()
    assert (found["steps"], found["epochs"]) == (expected["steps"], expected["epochs"])
    assert found["metrics"].keys() == expected["metrics"].keys()
    assert found["metrics"] == pytest.approx(expected["metrics"], abs=0.03, rel=0.03)


#: with :data:`QUICK`, a run of four epochs in two processes
FOUR_EPOCHS = (TWO, "trainer.max_epochs=4", "trainer.batch_size=32", "tracking=none")


@pytest.fixture(scope="module")
def expected(outputs):
    """What such a run finds if nothing disturbs it."""
    return execute(quick_config(outputs, *FOUR_EPOCHS)).metrics


def begin(raw):
    os.setsid()
    execute(raw, wait=True)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_killed_it_ends_as_if_it_had_not_been_and_leaves_nothing_behind(tmp_path, expected):
    """Killed once: that a run survives ten kills, tests/system/test_kill.py shows of one process."""
    killed = quick_config(tmp_path / "killed", *FOUR_EPOCHS)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["sextant.lifecycle.training", "sextant.chapters.classification.chapter"])
    process = context.Process(target=begin, args=(killed,))
    process.start()
    wait_for(tmp_path / "killed", CHECKPOINT, lambda: not process.is_alive())
    others = psutil.Process(process.pid).children(recursive=True)
    assert others
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert not psutil.wait_procs(others, timeout=30)[1]  # they notice
    assert execute(killed).metrics == expected
    assert len(all_runs(tmp_path / "killed")) == 1


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_death_of_another_process_is_told_and_the_run_goes_on_from_its_last_epoch(tmp_path):
    words = [
        *QUICK,
        TWO,
        "trainer.max_epochs=400",
        "trainer.batch_size=32",
        "tracking=none",
        f"paths.outputs={tmp_path}",
    ]
    process = subprocess.Popen([sys.executable, "train.py", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True)
    wait_for(tmp_path, CHECKPOINT, lambda: process.poll() is not None)
    children = psutil.Process(process.pid).children(recursive=True)
    (other,) = [child for child in children if any("rank_process" in word for word in child.cmdline())]
    other.kill()
    _, told = process.communicate(timeout=120)
    assert process.returncode == 2
    assert "process 1 of this run ended: by signal 9" in told
    (directory,) = all_runs(tmp_path)
    assert "process 1" in directory.state()["failure"]
    assert directory.last_checkpoint.is_file()


@pytest.mark.slow
def test_a_loss_that_is_no_number_in_one_process_ends_all(tmp_path):
    words = [*QUICK, TWO, "optimizer.lr=1e30", "tracking=none", f"paths.outputs={tmp_path}"]
    with pytest.raises(LossNotFiniteError):
        execute(to_plain(compose(words)))
    (directory,) = all_runs(tmp_path)
    assert directory.results()["outcome"] == "diverged"


@pytest.mark.slow
def test_training_ends_when_patience_does_and_a_killed_run_does_not_go_on(tmp_path):
    words = ["trainer.patience=2", "trainer.max_epochs=30", "optimizer.lr=1e-9", "tracking=none"]
    outcome = execute(quick_config(tmp_path, *words))
    directory = RunDirectory(outcome.directory)
    found = directory.results()
    assert found["epochs"] == 3  # the first is the best, as nothing is learnt
    directory.metrics.unlink()  # killed while it was tested
    assert RunDirectory(execute(quick_config(tmp_path, *words)).directory).results()["epochs"] == 3


@pytest.mark.slow
def test_a_compiled_network_learns_what_it_does_otherwise_and_is_tested_as_it_is(tmp_path):
    words = ["trainer.max_epochs=1", "inhibition=push_pull"]
    words += ["trainer.batch_size=37"]  # of 1295 images: a last batch of another size would be compiled anew
    plain, compiled = run(tmp_path, *words), run(tmp_path, *words, "trainer.compile=true")
    assert losses(compiled) == pytest.approx(losses(plain), rel=1e-3)
    assert compiled.results()["cost"] == plain.results()["cost"]
    states = [load_checkpoint(each.last_checkpoint)["state_dict"] for each in (plain, compiled)]
    assert states[0].keys() == states[1].keys()


@pytest.mark.slow
def test_gradients_of_several_batches_make_one_step(tmp_path):
    one = run(tmp_path, "trainer.batch_size=64", "trainer.max_epochs=1", "schedule=constant")
    two = run(tmp_path, "trainer.batch_size=32", "trainer.max_epochs=1", "trainer.accumulate=2", "schedule=constant")
    assert two.results()["steps"] == one.results()["steps"]
    assert two.results()["metrics"]["val/loss"] == pytest.approx(one.results()["metrics"]["val/loss"], rel=1e-3)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_sweep_gives_each_run_of_several_processes_one_of_its_own(tmp_path, expected):
    joblib = ["seed=0,1", "launcher=joblib", "launcher.workers=1", f"paths.outputs={tmp_path}"]
    swept = run_sweep([*QUICK, *FOUR_EPOCHS, *joblib])
    assert swept.count("failed") == 0
    assert swept.outcomes[0].metrics == expected


def test_runs_of_before_are_the_same_experiment():
    raw = to_plain(compose(["trainer=fast"]))
    before = {key: v for key, v in raw["trainer"].items() if key not in ("accumulate", "patience", "compile")}
    assert digest({**raw, "trainer": before}) == digest(raw)
    for changed in ({"accumulate": 2}, {"patience": 3}, {"compile": True}, {"devices": 2}):
        assert digest({**raw, "trainer": {**raw["trainer"], **changed}}) != digest(raw)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["task=cosfire", TWO], r"trainer\.devices=2: task=cosfire configures filters.*\ntrainer\.devices=1"),
        (["task=localization", TWO], r"trainer\.devices=2: task=localization learns a few hyper-parameters"),
        (["task=localization", "trainer.compile=true"], r"trainer\.compile=True: task=localization"),
        (["task=localization", "trainer.accelerator=gpu"], r"trainer\.accelerator=gpu: task=localization learns a few"),
        (
            [TWO],
            r"launcher=local: a sweep's process cannot start a run of several.*\n.*launcher=joblib launcher\.workers=1",
        ),
        ([TWO, "launcher=ray"], r"trainer\.devices=2 needs as many cpus; a run has launcher\.cpus=1\nlauncher\.cpus=2"),
        (["trainer.devices=4", "trainer.batch_size=3"], r"trainer\.devices=4 cannot share batches of 3"),
        (["trainer.accumulate=30", "trainer.log_every=20"], r"must be at most trainer\.log_every=20"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(tmp_path, words, told):
    with pytest.raises(UserError) as error:
        run_sweep([*words, "seed=0,1", "tracking=none", f"paths.outputs={tmp_path}"])
    assert re.search(told, str(error.value))
