"""Training builds what another run's checkpoint names only if the run is one of the user's own."""

from types import SimpleNamespace

import pytest
import torch

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError
from sextant.recipes.cosfire import CosfireRecipe
from sextant.recipes.descriptors import TrainedDescriptor
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
    with pytest.raises(UserError, match=r"wants to build os\.mkdir.*\n.*name a run in the folder of runs"):
        TrainedDescriptor(str(path)).describer(tmp_path / "outputs")
    assert not (tmp_path / "executed").exists()


def test_nor_do_its_features(tmp_path):
    path = sent(tmp_path / "sent.ckpt", "classification")
    chosen = ["task=cosfire", "features=run", f"features.run={path}", f"paths.outputs={tmp_path / 'outputs'}"]
    config = validate(to_plain(compose(chosen)))
    shape = SimpleNamespace(channels=3, height=16, width=16, classes=("a",))
    with pytest.raises(UserError, match=r"wants to build os\.mkdir"):
        CosfireRecipe(Reporter()).spec(config, SimpleNamespace(spec=lambda: shape), None)
