"""Training builds what another run's checkpoint names only if the run is one of the user's own."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from sextant.atomic_files import write_json
from sextant.chapters.cosfire.chapter import CosfireChapter
from sextant.chapters.places.descriptors import TrainedDescriptor, describer
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.reporter import Reporter
from sextant.runs.checkpoint import KEY
from sextant.torch_file import save_sealed


def sent(path, task):
    """A checkpoint that somebody sent, whose backbone is a function that makes a folder."""
    raw = to_plain(compose([f"task={task}"]))
    raw["backbone"] = {"_target_": "os.mkdir", "path": str(path.parent / "executed")}
    spec = {"channels": 3, "height": 16, "width": 16, "classes": ["a"]}
    with path.open("wb") as file:
        save_sealed(
            {
                "state_dict": {"x": torch.zeros(1)},
                KEY: {"schema_version": 1, "task": task, "config": raw, "spec": spec},
            },
            file,
        )
    return path


def test_a_descriptor_of_a_file_from_elsewhere_runs_no_code_that_it_names(tmp_path):
    path = sent(tmp_path / "sent.ckpt", "place_recognition")
    with pytest.raises(UserError, match=r"paths outside Sextant: os\.mkdir.*\n.*name a run in the folder of runs"):
        TrainedDescriptor(str(path)).describer(tmp_path / "outputs")
    assert not (tmp_path / "executed").exists()


class Named:
    """A descriptor of a user's own, with an argument of a name that landmarks have for something else."""

    dimension = 3

    def __init__(self, network):
        self.network = network

    def fit(self, images):
        return self

    def describe(self, images):
        return images.reshape(len(images), -1)[:, :3].astype(np.float32)


def test_a_network_of_a_descriptor_of_ones_own_is_no_run(tmp_path):
    raw = to_plain(compose(["task=localization", f"paths.outputs={tmp_path}"]))
    raw["descriptor"] = {"_target_": f"{__name__}.Named", "network": "resnet18"}
    assert describer(validate(raw)).descriptor.network == "resnet18"


def test_the_network_of_landmarks_is_looked_for_among_the_runs_of_the_outputs(tmp_path):
    photo, run = tmp_path / "photo.png", tmp_path / "outputs" / "runs" / "classification" / "abc-s0"
    Image.fromarray(np.zeros((60, 80, 3), np.uint8)).save(photo)
    given = [f"descriptor.photo={photo}", "descriptor.points=[[30,20]]", "descriptor.network=abc-s0"]
    words = ["task=localization", "descriptor=landmarks", *given, f"paths.outputs={tmp_path / 'outputs'}"]
    config = validate(to_plain(compose(words)))
    with pytest.raises(UserError, match=r"descriptor\.network=abc-s0: no run"):
        describer(config)
    write_json(run / "run.json", {"task": "classification", "digest": "abc", "seed": 0})
    (run / "checkpoints").mkdir()
    sent(run / "checkpoints" / "last.ckpt", "classification")
    assert describer(config).descriptor.network == str(run / "checkpoints" / "last.ckpt")


def test_nor_do_its_features(tmp_path):
    path = sent(tmp_path / "sent.ckpt", "classification")
    chosen = ["task=cosfire", "features=run", f"features.run={path}", f"paths.outputs={tmp_path / 'outputs'}"]
    config = validate(to_plain(compose(chosen)))
    shape = SimpleNamespace(channels=3, height=16, width=16, classes=("a",))
    with pytest.raises(UserError, match=r"import paths outside Sextant: os\.mkdir"):
        CosfireChapter(Reporter()).spec(config, SimpleNamespace(spec=lambda: shape), None)
