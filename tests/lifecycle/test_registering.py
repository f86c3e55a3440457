"""Runs as models of MLflow's registry, which answer photos as the run does."""

import base64
import io
import json
import os
import socket
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import tiny_calibration
import tiny_places
from support import quick_config
from tiny_digits import PLAIN, digits_run

import sextant
from sextant import cli
from sextant.errors import UserError
from sextant.lifecycle.execute import execute
from sextant.lifecycle.offered import photo_predictor
from sextant.lifecycle.registering import register_run
from sextant.tracking.registry import answered
from sextant.tracking.server import guarded
from sextant.tracking.store import open_store

REQUESTS = 30


def photo(number, kind="png"):
    """An image file."""
    content = io.BytesIO()
    tiny_places.scene(number).save(content, kind)
    return content.getvalue()


PHOTOS = [photo(1), photo(2, "jpeg"), b"nonsense"]


@pytest.fixture(scope="module")
def places(outputs):
    return tiny_places.tiny_checkpoint(outputs / "places" / "checkpoints" / "last.ckpt")


def loaded(outputs, version):
    """The registered model, as MLflow loads it."""
    import mlflow

    mlflow.set_tracking_uri(open_store("sqlite", None, outputs).uri)
    try:
        return mlflow.pyfunc.load_model(f"models:/{version}")
    finally:
        mlflow.set_tracking_uri(None)


def table(photos):
    import pandas as pd

    return pd.DataFrame({"image": photos})


@pytest.mark.slow
def test_a_registered_run_answers_as_the_run_does(outputs, places, capsys):
    cli.run("register", [f"run={places}", "name=places", f"outputs={outputs}"])
    assert "models:/places/1" in capsys.readouterr().out
    assert register_run(str(places), "places", outputs).version == 2
    rows = loaded(outputs, "places/2").predict(table(PHOTOS))
    assert rows == answered(photo_predictor(places), PHOTOS)
    assert [row["error"] for row in rows[:2]] == ["", ""]
    assert rows[2]["descriptor"] is None
    assert rows[2]["error"].startswith("cannot be decoded (8 bytes)")
    assert np.linalg.norm(rows[0]["descriptor"]) == pytest.approx(1, abs=1e-5)


@pytest.mark.slow
def test_a_name_with_a_dot_and_a_model_of_an_earlier_version_are_served(places, tmp_path):
    """Models registered before the distribution was renamed name it by its old name."""
    assert register_run(str(places), "a.b", tmp_path).version == 1
    named = f"sextant-vision=={sextant.__version__}"
    pinned = [
        path for path in tmp_path.rglob("artifacts/**/*") if path.is_file() and named in path.read_text(errors="ignore")
    ]
    assert {path.name for path in pinned} >= {"requirements.txt"}
    for path in pinned:
        path.write_text(path.read_text().replace(named, f"sextant=={sextant.__version__}"))
    assert loaded(tmp_path, "a.b/1").predict(table(PHOTOS)) == answered(photo_predictor(places), PHOTOS)


@pytest.mark.slow
def test_a_registered_run_has_a_signature_an_example_and_a_card_and_nothing_pickled(places, tmp_path):
    register_run(str(places), "signed", tmp_path)
    files = [path for path in tmp_path.rglob("artifacts/**/*") if path.is_file()]
    assert {path.suffix for path in files} <= {"", ".txt", ".yaml", ".json", ".py", ".md", ".ckpt"}
    assert {path.name for path in files} >= {"served_code.py", "input_example.json", "model_card.md"}
    model = loaded(tmp_path, "signed/1")
    assert [(column.name, column.type.name) for column in model.metadata.signature.inputs] == [("image", "binary")]
    assert [column.name for column in model.metadata.signature.outputs] == ["descriptor", "error"]
    with pytest.raises(Exception, match="image"):
        model.predict(table(PHOTOS).rename(columns={"image": "picture"}))
    version = open_store("sqlite", None, tmp_path).client.get_model_version("signed", "1")
    assert "| `descriptor` | doubles |" in version.description


@pytest.mark.slow
def test_a_registered_run_belongs_to_its_run_in_the_store(outputs):
    small = ["trainer.max_epochs=1", "tracking.kind=sqlite"]
    run = execute(quick_config(outputs, *small)).directory
    register_run(str(run), "digits", outputs)
    client = open_store("sqlite", None, outputs).client
    (model,) = client.search_model_versions("name='digits'")
    assert client.get_run(model.run_id).data.tags["sextant.run"] == f"classification/{run.name}"
    rows = loaded(outputs, "digits/1").predict(table(PHOTOS[:1]))
    path = outputs / "photo.png"
    path.write_bytes(PHOTOS[0])
    seen = sextant.ImageClassifier.load(run).classify(path)
    assert rows == [{"label": seen.label, "score": pytest.approx(seen.probability), "error": ""}]


def test_cameras_have_their_intervals(tmp_path):
    checkpoint = tiny_calibration.tiny_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt")
    row, _, failed = answered(photo_predictor(checkpoint), PHOTOS)
    path = tmp_path / "photo.png"
    path.write_bytes(PHOTOS[0])
    camera = sextant.PhotoCalibrator.load(checkpoint).calibrate(path)
    assert (row["focal_px"], row["verdict"]) == (pytest.approx(camera.focal_px), camera.verdict)
    assert (row["tilt_deg_low_95"], row["tilt_deg_high_95"]) == pytest.approx(camera.interval_95.tilt_deg)
    assert failed["focal_px"] is None
    assert str(tmp_path) not in failed["error"]
    assert failed["error"].startswith("image 2")


@pytest.mark.slow
def test_filters_answer_by_their_first_method(tmp_path):
    run = digits_run(tmp_path, *PLAIN[3:], "task.prices=[10]")
    rows = answered(photo_predictor(run.last_checkpoint), PHOTOS)
    assert {row["label"] for row in rows[:2]} <= {str(digit) for digit in range(10)}
    assert all(isinstance(row["score"], float) for row in rows[:2])
    assert "cannot be decoded" in rows[2]["error"]


def test_what_answers_no_photos_says_so(tmp_path):
    import torch

    from sextant.runs.checkpoint import KEY, SCHEMA_VERSION

    path = tmp_path / "last.ckpt"
    torch.save(
        {KEY: {"schema_version": SCHEMA_VERSION, "task": "localization", "config": {}, "spec": {}}, "state_dict": {}},
        path,
    )
    with pytest.raises(UserError, match="a model of task=localization does not predict from single photos"):
        photo_predictor(path)


def test_a_bad_name_is_reported(outputs, places):
    with pytest.raises(UserError, match=r"name=a/b:c must be 1 to 200 letters"):
        register_run(str(places), "a/b:c", outputs)


@pytest.mark.slow
def test_a_served_model_answers_many_requests(outputs, places, monkeypatch):
    register_run(str(places), "served", outputs)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv("MLFLOW_TRACKING_URI", open_store("sqlite", None, outputs).uri)
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(Path(sextant.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    )
    bin_folder = str(Path(sys.executable).parent)  # as if the environment were activated: MLflow calls uvicorn
    monkeypatch.setenv("PATH", os.pathsep.join([bin_folder, os.environ["PATH"]]))
    command = [sys.executable, "-m", "mlflow", "models", "serve", "-m", "models:/served/1", "--env-manager", "local"]
    wanted = answered(photo_predictor(places), [photo(number) for number in range(REQUESTS)])
    with guarded([*command, "--host", "127.0.0.1", "--port", str(port)]) as server:
        while not _listening(port):
            assert server.poll() is None
        for number in range(REQUESTS):
            (row,) = _asked(port, photo(number))
            assert row == {"descriptor": pytest.approx(wanted[number]["descriptor"], abs=1e-6), "error": ""}


def _listening(port):
    with socket.socket() as probe:
        probe.settimeout(1)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _asked(port, content):
    """The rows that a server on this machine answers."""
    data = {"dataframe_split": {"columns": ["image"], "data": [[base64.b64encode(content).decode()]]}}
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/invocations", json.dumps(data).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=60) as answer:
        return json.load(answer)["predictions"]
