"""``sextant benchmark calibration`` on a few drawn photos, by a network that was never trained."""

import csv
import hashlib
import json
from functools import partial

import numpy as np
import pytest
import torch
from baselines.calibration.drawings import cameras, picture
from models.published_cameras import anycalib
from PIL import Image
from tiny_calibration import tiny_checkpoint


@pytest.fixture
def benchmark(run_verb):
    return partial(run_verb, "benchmark")


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    rows = ["file,f_px,tilt_deg,roll_deg,k1"]
    for i, (tilt, roll, heading, focal, _) in enumerate(cameras(3, k1=(-0.01, 0.0))):
        Image.fromarray(picture(tilt, roll, heading, focal, 0.0, seed=i, noise=6)).save(folder / f"{i}.png")
        rows.append(f"{i}.png,{192 * focal:.3f},{np.degrees(tilt):.3f},{np.degrees(roll):.3f},0")
    (folder / "known.csv").write_text("\n".join(rows) + "\n")
    return folder


@pytest.mark.slow
def test_all_methods_are_measured_and_written(benchmark, photos, tmp_path):
    checkpoint = tiny_checkpoint(tmp_path / "last.ckpt")
    given = (f"run={checkpoint}", f"folder={photos}", f"output={tmp_path / 'out'}", "cuts=3")
    status, said = benchmark("calibration", *given)
    assert status == 0, said
    assert "3 photos measured" in said
    assert "cuts=3 is for panoramas, of which this folder has none" in said
    with open(tmp_path / "out" / "benchmark.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["photo"]) for row in rows[:4]] == [
        ("network", "0.png"), ("network", "1.png"), ("network", "2.png"), ("lines", "0.png"),
    ]  # fmt: skip
    by = {m: np.median([float(r["tilt_deg"]) for r in rows if r["method"] == m]) for m in ("network", "lines", "joint")}
    assert by["lines"] < 1.5
    assert by["joint"] < max(2 * by["lines"], 1)  # though the network knows nothing
    text = (tmp_path / "out" / "benchmark.md").read_text()
    for part in ("# known", "| joint | 3 |", "*GeoCalib, LaMAR*", "Truth inside the interval", "| not trustworthy |"):
        assert part in text


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """A file of random weights in AnyCalib's layout."""
    path = tmp_path_factory.mktemp("others") / "theirs.pt"
    torch.manual_seed(0)
    torch.save(anycalib(), path)
    return path


@pytest.mark.slow
def test_the_scale_of_a_network_of_others_is_fitted_and_used(benchmark, photos, others, tmp_path):
    shared = ("calibration", f"network=anycalib:{others}", f"folder={photos}")
    status, said = benchmark(*shared, f"output={tmp_path / 'out'}")
    assert status == 0, said
    for part in ("not supplied by Sextant; spreads as the network gives them", "Scale of the network's spreads"):
        assert part in said
    file = tmp_path / "out" / "network_scale.json"
    content = json.loads(file.read_text())
    assert content["network"]["sha256"] == hashlib.sha256(others.read_bytes()).hexdigest()
    assert content["photos"][:3] == [0, 0, 3]  # rays say nothing of tilt and roll
    content["scale"]["vfov"] = 2.5
    file.write_text(json.dumps(content))
    status, said = benchmark(*shared, f"scale={file}", f"output={tmp_path / 'scaled'}")
    assert status == 0, said
    assert f"spreads by {file}" in said
    assert not (tmp_path / "scaled" / "network_scale.json").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("run=zoo:calibration", "network=anycalib:x.pt"), "are two networks"),
        (("scale=x.json",), "is for a network of others"),
        (("network=deepcalib:x.pt",), "must be geocalib:<file> or anycalib:<file>"),
        (("network=anycalib:x.pt",), "network=anycalib:x.pt: there is no such file"),
    ],
)
def test_mistakes_about_a_network_of_others_are_told(benchmark, arguments, says, photos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, said = benchmark("calibration", f"folder={photos}", *arguments)
    assert status == 2
    assert says in said.replace("\n", " ")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "name what to measure"),
        (("places",), "name what to measure"),
        (("calibration",), "folder= is missing"),
        (("calibration", "folder=x", "cuts=0"), "cuts=0 must be a whole number from 1 up"),
        (("calibration", "folder=x", "sampling=photo"), "Did you mean sampling=photos?"),
        (("calibration", "folder=x"), "x does not exist"),
    ],
)
def test_mistakes_are_told(benchmark, arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    checkpoint = tiny_checkpoint(tmp_path / "last.ckpt")
    status, said = benchmark(*arguments, *([f"run={checkpoint}"] if len(arguments) > 1 else []))
    assert status == 2
    assert says in said.replace("\n", " ")
