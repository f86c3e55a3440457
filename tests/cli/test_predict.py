import json
import subprocess
import sys
from types import SimpleNamespace

import pytest
import torch
from PIL import Image
from support import fill_disk

from sextant.chapters.calibration.options import CalibrationOptions
from sextant.cli import predict, run
from sextant.errors import UserError
from sextant.kit import handler
from sextant.registry import CHAPTERS
from sextant.runs.checkpoint import KEY
from sextant.runs.resolve import FoundRun

HEAVY = ("torch", "pytorch_lightning", "mlflow", "matplotlib", "cv2", "numba", "scipy", "sklearn")
#: prints for each command its status, what it said and which of those modules are imported by then
PROBE = f"""
import contextlib, io, json, sys
from sextant.cli import run

for arguments in json.loads(sys.argv[1]):
    status, said = 0, io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            run("predict", arguments)
        except SystemExit as ended:
            status = ended.code
    print(json.dumps([status, said.getvalue(), [name for name in {HEAVY!r} if name in sys.modules]]))
"""
MISTAKES = [
    (["--help"], 0, "run=<MLflow run id"),
    ([], 2, "input= is missing"),
    (["run=x", "input={input}"], 2, "output= is missing"),
    (["run=x", "input={input}", "output={output}", "camera=two"], 2, "camera=two must be one of each, one"),
    (["run=x", "input={input}", "output={output}", "focal_pior=3"], 2, "Did you mean focal_prior=3?"),
    (["run=x", "input={output}/*.jpg", "output={output}"], 2, "no photo there"),
    (["run=x", "input={input}", "output={output}", "outputs={output}"], 2, "run=x: no run"),
    (["run=x", "input={input}", "output={input}"], 2, "is not a folder that can be written to"),
    (["run=x", "map={folder}", "queries={folder}", "output={output}"], 2, "are the same folder"),
]


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "a.png"
    Image.new("RGB", (64, 48)).save(path)
    return path


def test_mistakes_are_told_before_anything_heavy_is_imported(tmp_path, picture):
    places = {"input": picture, "folder": tmp_path, "output": tmp_path / "out"}
    given = json.dumps([[argument.format(**places) for argument in arguments] for arguments, *_ in MISTAKES])
    done = subprocess.run(
        [sys.executable, "-c", PROBE, given], stdout=subprocess.PIPE, text=True, timeout=60, cwd=tmp_path, check=True
    )
    for line, (arguments, status, says) in zip(done.stdout.splitlines(), MISTAKES, strict=True):
        found, said, imported = json.loads(line)
        assert (found, imported) == (status, []), arguments
        assert says in said, arguments


def test_help_has_every_key_in_one_column_and_its_meaning_in_another(capsys):
    with pytest.raises(SystemExit):
        predict.main(["--help"])
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert [line.split()[0] for line in lines] == list(predict.KEYS)
    assert set(CalibrationOptions.meanings()) < set(predict.KEYS)
    (column,) = {line.index(meaning) for line, meaning in zip(lines, predict.KEYS.values(), strict=True)}
    assert all(line[column - 1] == " " for line in lines)


@pytest.fixture
def classifier(tmp_path, monkeypatch, request):
    """A run of classification whose model says that everything is a cat."""
    spec = {"channels": 3, "height": getattr(request, "param", 16), "width": 16, "classes": ["cat", "dog"]}
    content = {KEY: {"task": "classification", "spec": spec}}
    monkeypatch.setattr(handler, "resolve_run", lambda *_: FoundRun(tmp_path / "last.ckpt", None))
    monkeypatch.setattr("sextant.kit.trained.read_trained", lambda path: content)
    module = "sextant.chapters.classification.predict"
    said = torch.tensor([[0.5, 0.25]])
    opened = SimpleNamespace(probabilities=lambda images: said.expand(len(images), 2))
    monkeypatch.setattr("sextant.chapters.classification.classifier.ImageClassifier.of", lambda *_, **__: opened)
    monkeypatch.setattr(f"{module}.draw", lambda *_: None)


@pytest.mark.parametrize("classifier", [16, 24], indirect=True)
def test_classes_are_written(tmp_path, picture, classifier, capsys):
    out = tmp_path / "out"
    predict.main(["run=x", f"input={picture}", f"output={out}"])
    assert json.loads((out / "predictions.json").read_text()) == [
        {
            "file": str(picture),
            "class": "cat",
            "probability": 0.5,
            "probabilities": {"cat": 0.5, "dog": 0.25},
        }
    ]
    assert (out / "predictions.csv").read_bytes() == (
        f"file,class,probability,error\r\n{picture},cat,0.5,\r\n".encode()
    )
    assert "1 image classified" in capsys.readouterr().out


def test_if_no_image_can_be_read_the_command_fails_and_names_them_all(tmp_path, classifier, capsys):
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    (photos / "a.jpg").touch()
    (photos / "b.png").write_bytes(b"nothing")
    (photos / "c.png").symlink_to(photos / "gone.png")
    with pytest.raises(SystemExit) as ended:
        run("predict", ["run=x", f"input={photos}", f"output={out}"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert f"input={photos}: none of 3 images could be read" in said
    for name, why in (
        ("a.jpg", "is empty"),
        ("b.png", "cannot be decoded (7 bytes)"),
        ("c.png", "is a broken link"),
    ):
        assert f"{photos / name}: {why}" in said
    assert len(json.loads((out / "predictions.json").read_text())) == 3


def test_images_that_were_skipped_are_in_a_table_with_reasons(tmp_path, picture, classifier, capsys):
    (tmp_path / "b.png").write_bytes(b"nothing")
    predict.main(["run=x", f"input={tmp_path}", f"output={tmp_path / 'out'}"])
    out = capsys.readouterr().out
    said = " ".join(out.replace("│", " ").split())
    assert "Skipped (1)" in said
    cells = [line.split("│")[1:3] for line in out.splitlines() if line.count("│") == 3]  # long ones are folded
    assert "".join(name.strip() for name, _ in cells).endswith("b.png")
    assert " ".join(" ".join(why for _, why in cells).split()) == "cannot be decoded (7 bytes): it is text"
    assert "1 image classified, 1 could not be read" in said


@pytest.mark.parametrize("name", ["predictions.json", "predictions.csv"])
def test_a_full_disk_while_classes_are_written(tmp_path, picture, classifier, monkeypatch, name):
    fill_disk(monkeypatch, name)
    with pytest.raises(UserError, match="the disk is full"):
        predict.main(["run=x", f"input={picture}", f"output={tmp_path / 'out'}"])
    assert not (tmp_path / "out" / name).exists()


def test_a_key_of_calibration_is_refused_by_a_classifier(tmp_path, picture, classifier):
    with pytest.raises(UserError, match="undistort= belongs to calibration; this is a model of classification"):
        predict.main(["run=x", f"input={picture}", f"output={tmp_path / 'out'}", "undistort=all"])


def test_every_task_of_a_run_has_a_handler_and_a_key_of_two_tasks_says_both():
    assert set(CHAPTERS) < set(predict.HANDLERS)
    handlers = list({type(each): each for each in predict.HANDLERS.values()}.values())
    own = [key for handler in handlers for key in handler.keys]
    assert {key for key in own if own.count(key) > 1} == {"colmap", "every"}
    assert all(handler.keys[key] in predict.KEYS[key] for handler in handlers for key in handler.keys)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["map={folder}", "queries={input}", "every=2"], "every= does not go with map= and queries="),
        (["task=cosfire", "prototype={input}", "map={folder}"], "map= does not go with task=cosfire"),
        (["input={input}", "every=2"], "every= belongs to calibration and localization; this is a model of"),
        (["input={input}", "colmap=true"], "colmap= belongs to calibration and place_recognition; this is a model of"),
        (["map={folder}", "queries={input}"], "map= belongs to place_recognition; this is a model of classification"),
    ],
)
def test_keys_of_several_tasks_do_not_go_together(tmp_path, picture, classifier, arguments, says):
    folder = tmp_path / "map"
    folder.mkdir()
    Image.new("RGB", (64, 48)).save(folder / "b.png")
    given = [argument.format(input=picture, folder=folder) for argument in arguments]
    with pytest.raises(UserError, match=says):
        predict.main(["run=x", f"output={tmp_path / 'out'}", *given])


def test_a_checkpoint_of_a_task_that_is_none(tmp_path, picture, classifier, monkeypatch):
    monkeypatch.setattr("sextant.kit.trained.read_trained", lambda path: {KEY: {"task": "dowsing"}})
    with pytest.raises(UserError, match="run=x is a model of task=dowsing"):
        predict.main(["run=x", f"input={picture}", f"output={tmp_path / 'out'}"])


def test_what_is_found_does_not_go_among_the_photos(picture, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        run("predict", [f"input={picture}", f"output={tmp_path}"])
    assert f"output={tmp_path} is a folder of the photos" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [picture]


def test_bytes_of_a_name_that_are_no_utf8_are_escaped(picture, tmp_path):
    picture.rename(tmp_path / "caf\udce9.png")
    run("predict", [f"input={tmp_path}", f"output={tmp_path / 'found'}", "run=zoo:digits"])
    (line,) = (tmp_path / "found" / "predictions.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert "caf\\udce9.png" in line
    run("predict", [f"input={tmp_path}", f"output={tmp_path / 'cameras'}"])
    assert "caf\\udce9.png" in (tmp_path / "cameras" / "calibrations.csv").read_text(encoding="utf-8")
    assert (tmp_path / "cameras" / "calibrations.png").is_file()
