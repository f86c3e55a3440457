"""``debug=``: a batch, the same batches, a profile, and a NaN that is found, kept and replayed."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml
from torch import nn

from sextant.chapters.classification.chapter import ClassificationChapter
from sextant.cli import replay as command
from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.data.digits import Digits
from sextant.errors import UserError
from sextant.kit.trained import own_config
from sextant.lifecycle.debugging import LossOfRepeated, Repeated, debugging, replay
from sextant.lifecycle.execute import execute
from sextant.runs.checkpoint import KEY, load_checkpoint
from sextant.runs.directory import RunDirectory
from sextant.tracking.further_loggers import further_loggers
from sextant.training.not_finite import Finding, NotFiniteError, keep_step, read_step

SMALL = ("corruption=none", "trainer.batch_size=32", "trainer.threads=1")


class Poison(nn.Module):
    """Divides by zero where one certain image is in the batch."""

    def __init__(self, total):
        super().__init__()
        self.total = total

    def forward(self, x):
        return x / (((255 * x).round().flatten(1).sum(1) - self.total) != 0)[:, None, None, None]


def config(tmp_path, *overrides):
    return to_plain(compose([*SMALL, "trainer.progress=false", f"paths.outputs={tmp_path}", *overrides]))


@pytest.mark.slow
def test_a_nan_is_found_kept_and_replayed(tmp_path, monkeypatch, capsys):
    images = Digits(28).read("train").images
    sums, counts = np.unique(images.sum((1, 2, 3), dtype=np.int64), return_counts=True)
    total = int(sums[counts == 1][40])
    plain = ClassificationChapter.new_network
    monkeypatch.setattr(
        ClassificationChapter, "new_network", lambda self, *args: nn.Sequential(Poison(total), plain(self, *args))
    )
    raw = config(tmp_path, "debug=nan")
    with pytest.raises(NotFiniteError, match=r"output of network\.0 \(Poison\) is not finite at step"):
        execute(raw)
    (path,) = tmp_path.glob("runs/classification/*/nan")
    run = RunDirectory(path.parent)
    results = run.results()
    assert results["outcome"] == "diverged"
    assert f"sextant replay run={run.path}" in results["message"]
    finding, step = read_step(run.path)
    assert (step["batch"].images.long().sum((1, 2, 3)) == total).sum() == 1
    assert finding.step == finding.batch
    again = replay(run.path)
    assert again.found.where == again.kept.where == finding.where
    command.main([f"run={run.path.name}", f"outputs={tmp_path}"])
    said = capsys.readouterr().out
    assert "in the replay: the output of network.0 (Poison) is not finite" in said
    monkeypatch.setattr(Poison, "forward", lambda self, x: x)  # mended
    with pytest.raises(UserError, match="all values were finite in the replay"):
        command.main([f"run={run.path}"])


@pytest.mark.slow
def test_one_batch_the_same_batches_and_a_profile(tmp_path, capsys):
    one = RunDirectory(execute(config(tmp_path, "debug=one_batch", "tracking.also=[csv]")).directory)
    assert (one.results()["epochs"], one.results()["steps"], one.results()["outcome"]) == (1, 1, "finished")
    assert own_config(load_checkpoint(one.last_checkpoint)[KEY]).debug is None  # a later evaluation is whole
    assert "train/loss" in (one.path / "csv" / "metrics.csv").read_text().splitlines()[0]
    over = RunDirectory(execute(config(tmp_path, "debug=overfit", "optimizer.lr=0.05", "schedule=constant")).directory)
    assert over.results()["steps"] == 150
    lines = [json.loads(line)["metrics"] for line in over.history.read_text().splitlines()]
    losses = [metrics["train/loss"] for metrics in lines if "train/loss" in metrics]
    assert losses[-1] < losses[0] / 10
    profiled = RunDirectory(execute(config(tmp_path, "debug=profiler")).directory)
    assert "run_training_batch" in (profiled.path / "fit-profile.txt").read_text()


def test_the_same_batches_come_in_every_epoch():
    drawn = iter(range(100))
    repeated = Repeated(lambda: drawn, 3)
    assert (len(repeated), list(repeated), list(repeated)) == (3, [0, 1, 2], [0, 1, 2])
    assert len(Repeated(lambda: [1, 2], 3)) == 2


def test_debug_is_part_of_a_run_and_its_absence_is_not(tmp_path):
    plain, debugged = config(tmp_path), config(tmp_path, "debug=nan", "tracking=sqlite")
    assert "debug" not in plain
    assert "debug" not in validate(plain).model_dump(by_alias=True)
    found = [digest(validate(raw).model_dump(by_alias=True)) for raw in (plain, debugged)]
    assert found[0] != found[1]
    also = config(tmp_path, "tracking.also=[csv]")
    assert digest(validate(also).model_dump(by_alias=True)) == found[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "package", "pattern"),
    [
        ("tensorboard", "tensorboard", "tensorboard/**/events.out.tfevents.*"),
        ("wandb", "wandb", "wandb/offline-run-*/*.wandb"),
    ],
)
def test_a_logger_with_its_package_writes_into_the_run(tmp_path, name, package, pattern):
    pytest.importorskip(package, reason=f"the extra {name} is not installed")
    run = RunDirectory(execute(config(tmp_path, "debug=one_batch", f"tracking.also=[{name}]")).directory)
    assert run.results()["outcome"] == "finished"
    assert any(b"train/loss" in file.read_bytes() for file in run.path.glob(pattern))


@pytest.mark.parametrize("name", ["tensorboard", "wandb"])
def test_a_logger_without_its_package_is_one_line(tmp_path, monkeypatch, name):
    from sextant.lifecycle.checks import preflight
    from sextant.tracking import further_loggers

    monkeypatch.setattr(further_loggers, "find_spec", lambda package: None)
    with pytest.raises(UserError, match=rf"tracking\.also=\[{name}\] needs {name}, which is not installed") as error:
        preflight([f"tracking.also=[{name}]", f"paths.outputs={tmp_path}"])
    assert error.value.fix == f"pip install 'sextant-vision[{name}]'"


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["tracking.also=[mlflow]"], "tracking.also.0='mlflow'"),
        (["debug=one_batch", "debug.overfit=2"], "exclude each other"),
        (["debug=fast"], "debug"),
    ],
)
def test_mistakes(tmp_path, overrides, said):
    from sextant.lifecycle.checks import preflight

    with pytest.raises(UserError) as error:
        preflight([*overrides, f"paths.outputs={tmp_path}"])
    assert said in str(error.value)


def test_a_run_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match="there is no run directory of that name"):
        command.main(["run=nothing", f"outputs={tmp_path}"])


def kept_step(tmp_path, raw):
    run = tmp_path / "runs" / "classification" / "received"
    finding = Finding("training loss", 0, 0, 0)
    with pytest.raises(NotFiniteError):
        keep_step(run, "")(finding, nn.Linear(1, 1), torch.ones(1), torch.get_rng_state())
    (run / "config.yaml").write_text(raw if isinstance(raw, str) else yaml.safe_dump(raw))
    return run


def test_a_run_directory_that_names_foreign_code_is_not_replayed(tmp_path):
    raw = config(tmp_path, "debug=nan")
    raw["backbone"] = {"_target_": "os.mkdir", "path": str(tmp_path / "executed")}
    run = kept_step(tmp_path, raw)
    with pytest.raises(UserError, match=r"names import paths outside Sextant: os\.mkdir") as error:
        command.main([f"run={run}"])
    assert "trust=true" in error.value.fix
    assert not (tmp_path / "executed").exists()
    with pytest.raises(UserError, match="backbone"):  # it is called, and is no network
        command.main([f"run={run}", "trust=true"])
    (watch,) = debugging(validate(raw), None, RunDirectory(run), None)
    with pytest.raises(NotFiniteError, match=f"sextant replay run={run} trust=true"):
        watch.found(Finding("training loss", 0, 0, 0), nn.Linear(1, 1), None, torch.get_rng_state())


@pytest.mark.parametrize("text", ["[1]", "a: [", "", "\0"])
def test_a_damaged_config_is_one_line(tmp_path, text):
    with pytest.raises(UserError, match=r"config\.yaml"):
        replay(kept_step(tmp_path, text))


def test_the_epochs_of_a_resumed_run_keep_their_numbers():
    said = []
    losses = LossOfRepeated(said.append)
    losses.on_train_end(None, None)
    for epoch, values in ((3, (4.0, 2.0)), (4, (None, None)), (5, (1.0, 1.0))):
        for value in values:
            losses.on_train_batch_end(
                SimpleNamespace(current_epoch=epoch), None, value and {"loss": torch.tensor(value)}
            )
    losses.on_train_end(None, None)
    assert said == ["debug=overfit: loss on 2 batches 3 in epoch 4, 1 in epoch 6"]


def test_a_resumed_run_continues_its_csv(tmp_path):
    def rows(*steps, **metrics):
        (logger,) = further_loggers(["csv"], RunDirectory(tmp_path))
        for step in steps:
            logger.log_metrics({"loss": float(step), **metrics}, step)
        logger.save()
        return (tmp_path / "csv" / "metrics.csv").read_text().splitlines()

    assert rows(1, 2, 3) == ["loss,step", "1.0,1", "2.0,2", "3.0,3"]
    assert rows(3, 4, lr=0.5) == ["loss,lr,step", "1.0,,1", "2.0,,2", "3.0,0.5,3", "4.0,0.5,4"]  # step 3 again
    assert rows(5) == ["loss,lr,step", "1.0,,1", "2.0,,2", "3.0,0.5,3", "4.0,0.5,4", "5.0,,5"]
    assert rows(0) == ["loss,lr,step", "0.0,,0"]


def test_weights_and_biases_sends_no_errors():
    assert os.environ["WANDB_ERROR_REPORTING"] == "false"
