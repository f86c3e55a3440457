import json
import subprocess
import sys

import pytest
from PIL import Image
from support import fill_disk

from sextant.cli import predict
from sextant.cli.photo_calibration.options import KEYS as CALIBRATION_KEYS
from sextant.errors import UserError
from sextant.runs.checkpoint import KEY
from sextant.runs.resolve import FoundRun

HEAVY = ("torch", "pytorch_lightning", "mlflow", "matplotlib", "cv2", "numba", "scipy", "sklearn")
PROBE = f"""
import sys
from sextant.cli import run
try:
    run("predict", sys.argv[1:])
finally:
    print("imported:", [name for name in {HEAVY!r} if name in sys.modules])
"""


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "a.png"
    Image.new("RGB", (64, 48)).save(path)
    return path


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["--help"], 0, "run=<MLflow run id"),
        ([], 2, "run= is missing"),
        (["run=x", "input={input}"], 2, "output= is missing"),
        (["run=x", "input={input}", "output={output}", "camera=two"], 2, "camera=two must be one of each, one"),
        (["run=x", "input={input}", "output={output}", "focal_pior=3"], 2, "Did you mean focal_prior=3?"),
        (["run=x", "input={output}/*.jpg", "output={output}"], 2, "no photo there"),
        (["run=x", "input={input}", "output={output}", "outputs={output}"], 2, "run=x: no run"),
        (["run=x", "input={input}", "output={input}"], 2, "is not a folder that can be written to"),
    ],
)
def test_mistakes_are_told_before_anything_heavy_is_imported(tmp_path, picture, arguments, status, says):
    places = {"input": picture, "output": tmp_path / "out"}
    given = [argument.format(**places) for argument in arguments]
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *given], capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False
    )
    assert done.returncode == status
    assert says in done.stdout + done.stderr
    assert done.stdout.endswith("imported: []\n")


def test_help_has_every_key_in_one_column_and_its_meaning_in_another(capsys):
    with pytest.raises(SystemExit):
        predict.main(["--help"])
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert [line.split()[0] for line in lines] == list(predict.KEYS)
    assert set(CALIBRATION_KEYS) < set(predict.KEYS)
    (column,) = {line.index(meaning) for line, meaning in zip(lines, predict.KEYS.values(), strict=True)}
    assert all(line[column - 1] == " " for line in lines)


@pytest.fixture
def classifier(tmp_path, monkeypatch):
    """A run of classification whose model says that everything is a cat."""
    monkeypatch.setattr(predict, "resolve_run", lambda reference, outputs: FoundRun(tmp_path / "last.ckpt", None))
    monkeypatch.setattr("sextant.runs.checkpoint.load_checkpoint", lambda path: {KEY: {"task": "classification"}})
    monkeypatch.setattr(
        predict, "_classify",
        lambda paths, *_: ([{"file": str(p), "class": "cat", "probability": 0.5} for p in paths], []),
    )  # fmt: skip


def test_classes_are_written(tmp_path, picture, classifier, capsys):
    out = tmp_path / "out"
    predict.main(["run=x", f"input={picture}", f"output={out}"])
    assert json.loads((out / "predictions.json").read_text()) == [
        {"file": str(picture), "class": "cat", "probability": 0.5}
    ]
    assert (out / "predictions.csv").read_bytes() == (
        f"file,class,probability,error\r\n{picture},cat,0.5,\r\n".encode()
    )
    assert "1 images classified" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["predictions.json", "predictions.csv"])
def test_a_full_disk_while_classes_are_written(tmp_path, picture, classifier, monkeypatch, name):
    fill_disk(monkeypatch, name)
    with pytest.raises(UserError, match="the disk is full"):
        predict.main(["run=x", f"input={picture}", f"output={tmp_path / 'out'}"])
    assert not (tmp_path / "out" / name).exists()


def test_a_key_of_calibration_is_refused_by_a_classifier(tmp_path, picture, classifier):
    with pytest.raises(UserError, match="undistort= belongs to calibration; this is a model of classification"):
        predict.main(["run=x", f"input={picture}", f"output={tmp_path / 'out'}", "undistort=all"])
