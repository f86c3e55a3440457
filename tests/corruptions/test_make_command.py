"""``python -m sextant.corruptions make`` end to end."""

import errno
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from filelock import FileLock
from support import heeds_signals

from sextant.atomic_files import read_json
from sextant.cli import corruptions_make
from sextant.corruptions import making

IMAGES = np.random.default_rng(0).integers(0, 256, (12, 32, 32, 3), dtype=np.uint8)


@pytest.fixture
def make(capsys, tmp_path):
    """Run ``make`` on a file of images; returns exit status and what was said."""
    np.save(tmp_path / "images.npy", IMAGES)
    np.save(tmp_path / "labels.npy", np.arange(12))

    def run(*changes):
        given = {
            "set": "cifar10_c",
            "input": tmp_path / "images.npy",
            "output": tmp_path / "out",
            "names": "fog,contrast",
        }
        given |= dict(change.split("=", 1) for change in changes)
        status = 0
        try:
            corruptions_make.run(["make", *(f"{key}={value}" for key, value in given.items() if value != "none")])
        except SystemExit as ended:
            status = ended.code
        said = capsys.readouterr()
        return status, " ".join((said.out + said.err).split())

    return run


def test_files_have_the_published_layout(make, tmp_path):
    status, said = make(f"labels={tmp_path / 'labels.npy'}", "names=fog,frost")
    assert (status, "2 corruptions" in said, "are not comparable with published" in said) == (0, True, True)
    for name in ("fog", "frost"):
        stored = np.load(tmp_path / "out" / f"{name}.npy", allow_pickle=False)
        assert (stored.dtype, stored.shape) == (np.uint8, (60, 32, 32, 3))
        assert all(np.any(block != IMAGES) for block in np.split(stored, 5))
    assert np.load(tmp_path / "out" / "labels.npy").tolist() == list(range(12)) * 5


def test_whole_files_are_kept_and_damaged_ones_made_again(make, tmp_path):
    assert make()[0] == 0
    files = {path.name: path for path in (tmp_path / "out").glob("*.npy")}
    before = {name: path.read_bytes() for name, path in files.items()}
    files["fog.npy"].write_bytes(before["fog.npy"][:1000])
    kept = files["contrast.npy"].stat().st_mtime_ns
    status, said = make()
    assert (status, "made 1 corruptions kept 1" in said) == (0, True)
    assert {name: path.read_bytes() for name, path in files.items()} == before
    assert files["contrast.npy"].stat().st_mtime_ns == kept
    assert "made 0 corruptions kept 2" in make()[1]


def test_labels_fit_the_file_with_most_severities_whichever_call_made_it(make, tmp_path):
    labels = f"labels={tmp_path / 'labels.npy'}"
    assert make(labels, "names=fog", "severities=2,4,5")[0] == 0
    status, said = make(labels, "names=contrast", "severities=3")
    assert (status, "labels.npy repeats the labels 3 times" in said) == (0, True)
    assert np.load(tmp_path / "out" / "labels.npy").tolist() == list(range(12)) * 3


def test_severities_seed_and_mode_are_used(make, tmp_path):
    variants = {"plain": [], "seed": ["seed=1"], "mode": ["mode=corrected"]}
    contents = {}
    for name, changes in variants.items():
        assert make("severities=2,5", f"output={tmp_path / name}", *changes)[0] == 0
        contents[name] = np.load(tmp_path / name / "fog.npy")
        assert contents[name].shape == (24, 32, 32, 3)
    assert not np.array_equal(contents["plain"], contents["seed"])
    difference = contents["mode"].astype(int) - contents["plain"]
    assert set(np.unique(difference)) == {0, 1}  # rounded down, or to the nearest


def test_a_dataset_brings_its_labels(make, tmp_path):
    status, _ = make("input=digits", "set=mnist_c", "names=stripe,zigzag")
    assert status == 0
    stripe, labels = (np.load(tmp_path / "out" / f"{name}.npy") for name in ("stripe", "labels"))
    assert stripe.ndim == 4
    assert len(stripe) == len(labels) > 100


@pytest.mark.parametrize(
    ("change", "texts"),
    [
        ("set=none", ["set= is missing", "cifar10_c, cifar100_c, mnist_c"]),
        ("input=none", ["input= is missing"]),
        ("output=none", ["output= is missing"]),
        ("set=cifar1000_c", ["set=cifar1000_c", "cifar100_c"]),
        ("names=fogg", ["names=fogg", "fog"]),
        ("severities=6", ["severities=6", "1,2,3,4,5"]),
        ("severities=1,1", ["severities"]),
        ("seed=-1", ["seed=-1"]),
        ("mode=right", ["mode=right", "faithful"]),
        ("device=abacus", ["device=abacus", "cpu"]),
        ("input=missing.npy", ["input=missing.npy", "missing.npy does not exist"]),
        ("input=cifar", ["input=cifar", "cifar10"]),
        ("input=town_panoramas", ["input=town_panoramas", "labelled images"]),
        ("sed=1", ["sed=1: unknown key", "seed=1"]),
    ],
)
def test_mistakes_are_told_and_nothing_is_written(make, tmp_path, change, texts):
    status, said = make(change)
    assert status == 2
    for text in texts:
        assert text in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "content", [b"", b"not numpy", "pickle", "archive", "cut", "float", "shape", "one colour image"]
)
def test_unusable_input_files_are_told(make, tmp_path, content):
    path = tmp_path / "bad.npy"
    if content == "pickle":
        np.save(path, np.array([{"run": "me"}], dtype=object), allow_pickle=True)
    elif content == "archive":
        with path.open("wb") as file:
            np.savez(file, IMAGES)
    elif content == "cut":
        np.save(path, IMAGES)
        path.write_bytes(path.read_bytes()[:-1])
    elif content in ("float", "shape"):
        np.save(path, IMAGES / 255 if content == "float" else IMAGES[0, 0])
    elif content == "one colour image":
        np.save(path, np.zeros((32, 32, 3), np.uint8))
    else:
        path.write_bytes(content)
    status, said = make(f"input={path}")
    assert (status, f"input={path}" in said, "unsafely" in said) == (2, True, False)
    assert content != b"not numpy" or "is not a .npy file" in said
    assert content != "one colour image" or content in said
    assert not (tmp_path / "out").exists()


def test_labels_that_are_there_are_not_replaced_by_others(make, tmp_path):
    given = np.arange(len(IMAGES))
    for name, labels in (("first", given), ("other", given[::-1])):
        np.save(tmp_path / f"{name}.npy", labels)
    assert make(f"labels={tmp_path}/first.npy")[0] == 0
    written = (tmp_path / "out" / "labels.npy").read_bytes()
    status, said = make(f"labels={tmp_path}/other.npy")
    assert (status, "has other labels" in said) == (2, True)
    assert make(f"labels={tmp_path}/first.npy")[0] == 0
    assert (tmp_path / "out" / "labels.npy").read_bytes() == written
    (tmp_path / "out" / "labels.npy").write_bytes(written[:-5])  # damaged
    assert make(f"labels={tmp_path}/first.npy")[0] == 0
    assert (tmp_path / "out" / "labels.npy").read_bytes() == written
    (tmp_path / "new").mkdir()
    np.save(tmp_path / "new" / "labels.npy", given[::-1])
    assert make(f"labels={tmp_path}/first.npy", f"output={tmp_path}/new")[0] == 2
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["labels.npy"]


def test_a_suffix_of_upper_case_is_one(make, tmp_path):
    np.save(tmp_path / "up.npy", IMAGES)
    (tmp_path / "up.npy").rename(tmp_path / "up.NPY")
    assert make(f"input={tmp_path}/up.NPY")[0] == 0


def test_labels_of_other_images_are_told(make, tmp_path):
    np.save(tmp_path / "few.npy", np.arange(3))
    assert "few.npy" in make(f"labels={tmp_path / 'few.npy'}")[1]


def test_a_folder_that_cannot_be_written_to_is_told(make, tmp_path):
    (tmp_path / "file").write_text("")
    status, said = make(f"output={tmp_path / 'file' / 'out'}")
    assert (status, "cannot be written to" in said) == (2, True)


def test_a_full_disk_is_told_before_and_during_the_work(make, monkeypatch):
    usage = type("Usage", (), {"free": 1000})
    with monkeypatch.context() as patch:
        patch.setattr("sextant.lifecycle.corruption_files.shutil.disk_usage", lambda _: usage)
        status, said = make()
        assert (status, "needs 0.4 MB, 0.0 MB is free" in said) == (2, True)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(making, "_corrupted", full)
    status, said = make()
    assert (status, "the disk is full" in said, "resumes" in said) == (2, True, True)


def test_two_processes_do_not_write_one_file_but_others_in_its_folder(make, tmp_path):
    (tmp_path / "out").mkdir()
    half_written = tmp_path / "out" / ".fog.npy.1.tmp"
    half_written.touch()
    with FileLock(tmp_path / "out" / ".fog.lock"):
        status, said = make()
        assert (status, "another process" in said) == (2, True)
        assert make("names=contrast")[0] == 0
        assert half_written.exists()
    assert make()[0] == 0
    assert not half_written.exists()


def test_a_set_is_made_in_parts_to_the_same_files(make, tmp_path):
    names = ("fog", "contrast", "pixelate")
    whole, parts = (f"names={','.join(names)}", f"output={tmp_path / 'parts'}"), ["shards=2", "shard=0"]
    assert make(whole[0])[0] == 0
    assert make(*whole, *parts)[0] == 0
    status, said = make(*whole, "shards=2")
    assert (status, "lacks files of these shards: shard=1 (contrast.npy)" in said) == (2, True)
    assert make(*whole, "shards=2", "shard=1")[0] == 0
    assert make(*whole, "shards=2")[0] == 0
    for name in names:
        assert (tmp_path / "parts" / f"{name}.npy").read_bytes() == (tmp_path / "out" / f"{name}.npy").read_bytes()
    assert read_json(tmp_path / "parts" / "corruptions.json") == read_json(tmp_path / "out" / "corruptions.json")


@pytest.mark.parametrize(
    ("given", "said"), [(["shards=2", "shard=2"], "numbered from 0 to 1"), (["shard=0"], "shards= is missing")]
)
def test_a_part_is_one_of_so_many(make, given, said):
    status, told = make(*given)
    assert (status, said in told) == (2, True)


@pytest.mark.slow
def test_an_interrupted_process_resumes_to_the_same_files(make, tmp_path):
    """The real command, stopped by Ctrl-C once its first file is there."""
    np.save(tmp_path / "many.npy", np.tile(IMAGES, (100, 1, 1, 1)))
    arguments = ["set=cifar10_c", f"input={tmp_path / 'many.npy'}", "names=contrast,glass_blur,fog"]
    command = [sys.executable, "-m", "sextant.corruptions", "make", *arguments, f"output={tmp_path / 'out'}"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=heeds_signals
    )
    while not list((tmp_path / "out").glob("*.npy")) and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=120)[0]
    done = all((tmp_path / "out" / f"{name}.npy").exists() for name in ("contrast", "glass_blur", "fog"))
    assert process.returncode == 130 or done  # a process that is done may end by the signal: Python handles none then
    if not done:
        assert "Interrupted: " in said
        assert not list((tmp_path / "out").glob("*.tmp"))
    assert make(*arguments)[0] == 0
    assert make(*arguments, f"output={tmp_path / 'whole'}")[0] == 0
    for name in ("contrast", "glass_blur", "fog"):
        assert (tmp_path / "out" / f"{name}.npy").read_bytes() == (tmp_path / "whole" / f"{name}.npy").read_bytes()


@pytest.mark.parametrize("arguments", [[], ["--help"], ["make", "-h"]])
def test_help_names_every_key(capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        corruptions_make.run(arguments)
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert all(key in said for key in corruptions_make.MakeOptions.meanings())


def test_another_verb_is_not_understood(capsys):
    with pytest.raises(SystemExit):
        corruptions_make.run(["bake"])
    assert "bake: not understood" in capsys.readouterr().err
