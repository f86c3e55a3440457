"""Images of the user's own, told by a finished run of recognition by filters."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from tiny_digits import arrays, usual_run

from sextant.chapters.cosfire import serving
from sextant.cli import predict
from sextant.data.digits import Digits
from sextant.errors import UserError
from sextant.runs.checkpoint import KEY


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    return usual_run(tmp_path_factory)


@pytest.fixture
def photos(tmp_path):
    """Test images of the run as files, and one that is none."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, image in enumerate(Digits().read("test").images[::4][:12]):
        Image.fromarray(image[0]).save(folder / f"{number:02d}.png")
    (folder / "99.png").write_bytes(b"no image")
    return folder


def test_classes_are_those_that_the_test_found(usual, photos, tmp_path, capsys):
    out = tmp_path / "out"
    predict.main([f"run={usual.path}", f"input={photos}", f"output={out}"])
    assert "method cosfire_svm" in (told := capsys.readouterr().out)
    assert "12 images classified, 1 could not be read" in told
    rows = json.loads((out / "predictions.json").read_text())
    read = [row for row in rows if "error" not in row]
    assert [int(row["class"]) for row in read] == arrays(usual)["answer/cosfire_svm"][:12].tolist()
    for row in read:
        assert list(row["scores"]) == list("0123456789")
        assert row["score"] == max(row["scores"].values()) == row["scores"][row["class"]]
    table = list(csv.DictReader((out / "predictions.csv").open()))
    assert list(table[0]) == ["file", "class", "score", "error"]
    assert float(table[3]["score"]) == read[3]["score"]
    assert (out / "predictions.png").exists()


@pytest.mark.slow
def test_an_image_alone_has_the_scores_that_it_has_among_others(usual, photos, tmp_path):
    found = []
    for number, given in enumerate((photos, photos / "05.png")):
        predict.main([f"run={usual.path}", f"input={given}", f"output={tmp_path / str(number)}"])
        rows = json.loads((tmp_path / str(number) / "predictions.json").read_text())
        found.append(next(row for row in rows if row["file"].endswith("05.png")))
    np.testing.assert_allclose(*(list(row["scores"].values()) for row in found), atol=1e-5)


def test_photos_are_served_at_the_size_of_the_run(tmp_path, monkeypatch):
    wide = np.zeros((30, 60, 3), np.uint8)
    wide[:, 50:] = 255
    Image.fromarray(wide).save(tmp_path / "wide.png")
    seen = []

    def first_scores(images):
        seen.append(images)
        return torch.tensor([[-1.0, 0.5]])

    model = SimpleNamespace(estimator=SimpleNamespace(first_scores=first_scores))
    monkeypatch.setattr(serving, "own_config", lambda *_, **__: None)
    monkeypatch.setattr("sextant.kit.trained.model_from_checkpoint", lambda *_: model)
    spec = {"channels": 1, "height": 4, "width": 8, "classes": ["left", "right"]}
    predictor = serving.photo_predictor({KEY: {"spec": spec}}, tmp_path / "last.ckpt", trust=False)
    found, failed = predictor.predict([tmp_path / "wide.png", tmp_path / "gone.png"])
    assert (found["label"], found["score"], found["error"]) == ("right", 0.5, "")
    assert (failed["label"], "gone.png" in failed["error"]) == (None, True)
    assert (seen[0].shape, seen[0].dtype) == ((1, 1, 4, 8), torch.uint8)
    assert seen[0][..., 7].min() > 200
    assert seen[0][..., :5].max() < 50


@pytest.mark.parametrize("key", ["undistort=all", "sequence=3", "odometry=file.csv"])
def test_keys_of_other_tasks_are_refused(usual, photos, tmp_path, key):
    with pytest.raises(UserError, match="a model of cosfire"):
        predict.main([f"run={usual.path}", f"input={photos}", f"output={tmp_path / 'out'}", key])
