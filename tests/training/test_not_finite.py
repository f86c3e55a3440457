"""The first value that is not finite is named, wherever it is; what is kept names no foreign class."""

import collections
import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
import pytorch_lightning as pl
import torch
from torch import nn

from sextant.chapters.calibration.data.batches import CropBatch
from sextant.chapters.places.data.batches import PlaceBatch
from sextant.data.batches import Batch
from sextant.errors import UserError
from sextant.training.not_finite import Finding, NotFiniteError, WatchFinite, keep_step, packed, read_step, unpacked


class Sometimes(nn.Module):
    """Spoils batches whose first value is 3."""

    def __init__(self, kind):
        super().__init__()
        self.kind, self.weight = kind, nn.Parameter(torch.zeros(1))

    def forward(self, x):
        bad = bool(x.flatten()[0] == 3)
        if bad and self.kind == "output":
            return x / 0
        if bad and self.kind == "gradient":
            return x + self.weight.abs().sqrt() * self.weight  # 0 forward, 0 * inf backward
        if bad and self.kind == "weight":
            with torch.no_grad():
                self.weight.fill_(torch.inf)
        return x + self.weight * 0


class Model(pl.LightningModule):
    def __init__(self, kind):
        super().__init__()
        self.kind, self.first, self.second, self.last = kind, nn.Linear(2, 2), Sometimes(kind), nn.Linear(2, 1)

    def training_step(self, batch, batch_idx):
        given = torch.where(batch == 3, torch.nan, batch) if self.kind == "input" else batch
        loss = self.last(self.second(batch + 0 * self.first(given))).square().mean()
        return torch.log(-loss - 1) if self.kind == "loss" and batch[0, 0] == 3 else loss

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 1e-3)


BATCHES = [torch.full((4, 2), float(value)) for value in (1, 2, 3, 4)]
SAID = {
    "output": "output of second (Sometimes)",
    "gradient": "gradient of second.weight",
    "weight": "weight of second (Sometimes)",
    "input": "input of first (Linear)",
    "loss": "training loss",
}


def train(model, tmp_path):
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=1, logger=False, callbacks=[WatchFinite(keep_step(tmp_path, "the command"))],
        enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(model, torch.utils.data.DataLoader(BATCHES, batch_size=None))


@pytest.mark.parametrize("kind", SAID)
def test_where_and_when(tmp_path, kind):
    model = Model(kind)
    with pytest.raises(NotFiniteError) as error:
        train(model, tmp_path)
    finding, step = read_step(tmp_path)
    assert finding.where == SAID[kind]
    assert (finding.step, finding.epoch, finding.batch) == (2, 0, 2)
    assert SAID[kind] in str(error.value)
    assert "are kept: the command" in str(error.value)
    assert torch.equal(step["batch"], BATCHES[2])
    assert step["weights"].keys() == model.state_dict().keys()


def test_nothing_is_said_of_a_sound_training(tmp_path):
    train(Model("none"), tmp_path)
    assert not (tmp_path / "nan").exists()
    with pytest.raises(UserError, match="it has no step to replay"):
        read_step(tmp_path)


def test_a_damaged_step_is_told(tmp_path):
    with pytest.raises(NotFiniteError):
        train(Model("output"), tmp_path)
    path = tmp_path / "nan" / "step.pt"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(UserError, match="damaged"):
        read_step(tmp_path)


@pytest.mark.parametrize("kind", [Batch, CropBatch, PlaceBatch])
def test_batches_of_all_chapters_come_back(kind):
    values = {
        f.name: torch.rand(3) if f.default is dataclasses.MISSING else f.default for f in dataclasses.fields(kind)
    }
    back = unpacked(packed(kind(**values)))
    assert type(back) is kind
    for name, value in values.items():
        assert (
            torch.equal(getattr(back, name), value) if isinstance(value, torch.Tensor) else getattr(back, name) == value
        )


@pytest.mark.parametrize("name", ["os.system", "subprocess.Popen", "sextant.errors.UserError", "sextantic.x.Y"])
def test_no_other_class_is_built(name):
    with pytest.raises(UserError, match="is not one of Sextant's"):
        unpacked({"class": name, "fields": {"command": "exit"}})


@dataclasses.dataclass
class Foreign:
    images: torch.Tensor


def test_a_class_of_others_is_not_built_through_a_module_of_ours(monkeypatch):
    monkeypatch.setattr(sys.modules["sextant.training.not_finite"], "Foreign", Foreign, raising=False)
    with pytest.raises(UserError, match="is not one of Sextant's"):
        unpacked({"class": "sextant.training.not_finite.Foreign", "fields": {"images": 1}})


def test_arrays_scalars_and_tuples_come_back(tmp_path):
    given = {"a": np.arange(6.0)[::-2], "b": (np.float64(0.1), np.array(3)), 1: [np.bool_(True), None, "x"]}
    watch = keep_step(tmp_path, "the command")
    with pytest.raises(NotFiniteError, match="are kept: the command"):
        watch(Finding("loss", 1, 0, 1), Model("none"), given, torch.get_rng_state())
    back = read_step(tmp_path)[1]["batch"]
    np.testing.assert_array_equal(back["a"], given["a"])
    assert back["b"] == given["b"]
    assert [type(each) for each in back["b"]] == [np.float64, np.ndarray]
    assert back[1] == given[1]
    assert type(back[1][0]) is np.bool_


Pair = collections.namedtuple("Pair", "images labels")


@pytest.mark.parametrize(
    "held", [Path("a.png"), b"bytes", Pair(1, 2), Foreign(torch.zeros(1)), np.array(["a"]), {np.str_("a"): 1}]
)
def test_a_batch_that_cannot_be_kept_does_not_hide_the_finding(tmp_path, held):
    watch = keep_step(tmp_path, "the command")
    with pytest.raises(NotFiniteError):
        watch(Finding("loss", 1, 0, 1), Model("none"), torch.ones(1), torch.get_rng_state())
    with pytest.raises(NotFiniteError, match="the loss is not finite at step 7") as error:
        watch(Finding("loss", 7, 0, 7), Model("none"), [held], torch.get_rng_state())
    assert "could not be kept, so the step cannot be replayed" in error.value.fix
    assert error.value.fix.endswith(f"cannot keep a batch that holds a {type(held).__name__}")
    with pytest.raises(UserError, match=r"at step 7 .* but its batch was not kept"):
        read_step(tmp_path)
