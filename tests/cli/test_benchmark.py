"""``sextant benchmark calibration`` on a few drawn photos, by a network that was never trained."""

import csv

import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture
from PIL import Image
from tiny_calibration import tiny_checkpoint

from sextant import cli


@pytest.fixture
def benchmark(capsys):
    def run(*arguments):
        status = 0
        try:
            cli.run("benchmark", list(arguments))
        except SystemExit as ended:
            status = ended.code
        said = capsys.readouterr()
        return status, said.out + said.err

    return run


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
    status, said = benchmark("calibration", f"run={checkpoint}", f"folder={photos}", f"output={tmp_path / 'out'}")
    assert status == 0, said
    assert "3 photos measured" in said
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
