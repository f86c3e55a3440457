"""Runs, sweeps and their results as calls of a library, and the example of the guide."""

import math
import random
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

import sextant
from sextant.composing.config_files import groups
from sextant.errors import UserError
from sextant.lifecycle.results import sweep_results
from sextant.lifecycle.run_reporter import RunReporter
from sextant.runs.directory import RunDirectory
from sextant.runs.outputs_folder import conf_dir

GUIDE = Path(__file__).parents[2] / "docs" / "guide.md"
SMALL = ["trainer=fast", "trainer.batch_size=64", "corruption=none", "tracking=none"]


class Listening(RunReporter):
    """Writes down what it hears."""

    def __init__(self):
        self.heard = []

    def begin(self, config, directory, passed_over, published):
        self.heard.append(("begin", directory.path.name))

    def planned(self, plan, finished):
        self.heard.append(("planned", len(plan.cells), finished))


def _of_process():
    """What a run may set in its process."""
    return {
        "threads": torch.get_num_threads(),
        "deterministic": (torch.get_deterministic_debug_mode(), torch.backends.cudnn.benchmark),
        "warnings": list(warnings.filters),
        "random": (random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()),
    }


@pytest.fixture(scope="module")
def swept(outputs):
    """A sweep of two arms and two seeds, and a listener to it."""
    reporter = Listening()
    given = [*SMALL, f"paths.outputs={outputs}", "backbone=lenet_a", "seed=0,1", "inhibition=none,twin"]
    return sextant.sweep(overrides=given, reporter=reporter), reporter, given


def test_a_run_is_made_once_and_then_returned_and_leaves_its_process_as_it_was(swept, outputs, capsys):
    before = _of_process()
    reporter, overrides = Listening(), [*SMALL, f"paths.outputs={outputs}", "optimizer.lr=0.03"]
    overrides.append(f"trainer.threads={before['threads'] + 1}")
    first = sextant.run(overrides, reporter=reporter)
    assert _of_process() == before
    again = sextant.run(overrides)
    assert (first.reused, again.reused) == (False, True)
    assert first.directory == again.directory
    results = RunDirectory(first.directory).results()
    assert (first.metrics, first.status) == (again.metrics, again.status) == (results["metrics"], results["outcome"])
    assert 0 <= first.metrics["test/accuracy/clean"] <= 1
    assert reporter.heard == [("begin", first.directory.name)]
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.slow
def test_a_run_that_cannot_be_made_is_refused_before_there_is_a_directory(tmp_path):
    for override, said in (
        ("trainer.max_epoch=3", "Did you mean trainer.max_epochs=3?"),
        ("sweep=demo", "a sweep of many runs"),
        ("dataset.size=0", "dataset.size=0"),
    ):
        with pytest.raises(UserError, match=re.escape(said)):
            sextant.run([override, f"paths.outputs={tmp_path}"])
    assert not list(tmp_path.iterdir())


def test_a_sweep_runs_its_cells_here_and_then_only_what_is_missing(swept, outputs):
    found, reporter, given = swept
    assert (found.name, len(found.cells), found.count("failed")) == ("sweep", 4, 0)
    assert [cell.arm for cell in found.cells] == ["none", "none", "twin", "twin"]
    assert not any(outcome.reused for outcome in found.outcomes)
    again = sextant.sweep(overrides=given, reporter=reporter)
    assert all(outcome.reused for outcome in again.outcomes)
    assert [outcome.directory for outcome in again.outcomes] == [outcome.directory for outcome in found.outcomes]
    assert reporter.heard == [("planned", 4, 0), ("planned", 4, 4)]


def test_the_results_of_a_sweep_are_a_table(swept, outputs):
    found, _, _ = swept
    table = pd.DataFrame(sextant.load_results(found))
    assert table.equals(pd.DataFrame(sextant.load_results("sweep", outputs)))
    assert table.equals(pd.DataFrame(sextant.load_results(found.directory)))
    assert table[["arm", "seed"]].to_numpy().tolist() == [["none", 0], ["none", 1], ["twin", 0], ["twin", 1]]
    assert set(table["condition"]) == {"clean"}
    for row, outcome in zip(table.itertuples(), found.outcomes, strict=True):
        assert row.value == pytest.approx(100 * outcome.metrics["test/accuracy/clean"])
        assert (row.run, row.status) == (str(outcome.directory), outcome.status)
    twin, none = (table[table["arm"] == arm]["value"].tolist() for arm in ("twin", "none"))
    assert twin == none
    report = sextant.report(found)
    assert report[0] == found.directory / "report" / "report.md"
    assert "4 runs planned" in report[0].read_text()


def test_a_run_that_is_missing_is_a_row_without_a_value(swept):
    found, _, _ = swept
    gone = RunDirectory(found.outcomes[3].directory).metrics
    content = gone.read_bytes()
    gone.unlink()
    try:
        rows = sextant.load_results(found)
    finally:
        gone.write_bytes(content)
    assert (rows[3]["status"], rows[3]["condition"]) == ("missing", None)
    assert math.isnan(rows[3]["value"])
    assert sweep_results(found).count("missing") == 0


@pytest.mark.slow
def test_a_trained_run_is_tested_under_other_conditions(swept, outputs):
    found, _, _ = swept
    where = [f"paths.outputs={outputs}", "tracking=none"]
    tested = sextant.evaluate(found.outcomes[0].directory, [*where, "task.test_every=3"])
    assert tested.directory.parent.name == "evaluation"
    assert set(tested.metrics) == {f"test/{name}/clean" for name in ("accuracy", "ece", "nll")}
    with pytest.raises(UserError, match="belongs to the trained weights"):
        sextant.evaluate(found.outcomes[0].directory, [*where, "backbone=lenet_b"])


@pytest.mark.slow
def test_a_cell_that_fails_is_an_outcome(tmp_path):
    def launch_nothing(self, *given):
        raise OSError("no space")

    given = [*SMALL, f"paths.outputs={tmp_path}", "seed=0,1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sextant.lifecycle.training.train_and_test", launch_nothing)
        found = sextant.sweep(overrides=given)
    assert (found.count("failed"), found.outcomes[0].metrics) == (2, {})
    assert found.outcomes[1].message == "OSError: no space"


@pytest.mark.slow
def test_workers_compute_what_this_process_does(swept, tmp_path):
    found, _, given = swept
    there = sextant.sweep(overrides=[*given, f"paths.outputs={tmp_path}", "inhibition=none"], workers=2)
    assert len(there.outcomes) == 2
    assert [outcome.metrics for outcome in there.outcomes] == [outcome.metrics for outcome in found.outcomes[:2]]


def test_workers_of_a_launcher_that_has_none_are_refused():
    with pytest.raises(UserError, match=r"launcher\.workers=2"):
        sextant.sweep("demo", ["launcher=local"], workers=2)


def test_workers_are_those_of_the_launcher_that_is_chosen(monkeypatch):
    seen = []
    monkeypatch.setattr("sextant.lifecycle.library.sweep_or_search", lambda words, _: seen.append(words))
    for overrides in (["launcher=joblib"], []):
        sextant.sweep("demo", overrides, workers=2)
    assert [[word for word in words if "launcher" in word] for words in seen] == [
        ["launcher=joblib", "launcher.workers=2"]
    ] * 2


def test_config_files_of_ones_own_are_found(swept, outputs, tmp_path):
    own = tmp_path / "it's mine, all"
    (own / "backbone").mkdir(parents=True)
    text = (conf_dir() / "backbone" / "lenet_a.yaml").read_text()
    (own / "backbone" / "mine.yaml").write_text(text)
    where = [*SMALL, f"paths.outputs={outputs}"]
    with pytest.raises(UserError, match="backbone=mine: no such option"):
        sextant.run([*where, "backbone=mine"])
    with pytest.raises(UserError, match=re.escape("Did you mean backbone=mine?")):
        sextant.run([*where, "backbone=minee"], config_dir=own)
    with pytest.raises(UserError, match="config_dir=gone does not exist"):
        sextant.run(where, config_dir="gone")
    mine = sextant.run([*where, "backbone=mine"], config_dir=own)
    assert mine.reused
    assert mine.directory == swept[0].outcomes[0].directory
    assert "mine" not in groups()["backbone"]


@pytest.mark.slow
def test_the_example_of_the_guide_runs(tmp_path, monkeypatch, capsys):
    (example,) = re.findall(r"```python\n(import pandas.*?)```", GUIDE.read_text(), re.DOTALL)
    assert example.count("\n") <= 12
    smaller = example.replace("small = [", 'small = ["tracking=none", ')
    assert smaller != example
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    exec(compile(smaller, str(GUIDE), "exec"), {})
    assert re.search(r"clean +none +\d+\.\d+\n +push_pull +\d+\.\d+", capsys.readouterr().out)
    assert list(tmp_path.glob("sweeps/*/report/report.md"))


def test_importing_sextant_imports_nothing_heavy():
    program = "import sys, sextant; print([n for n in ('torch', 'hydra', 'numpy', 'yaml') if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    assert {"run", "sweep", "load_results"} <= set(dir(sextant))
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        _ = sextant.walk


@pytest.mark.parametrize("call", [sextant.run, sextant.sweep, sextant.evaluate])
@pytest.mark.parametrize(
    ("given", "fix"),
    [
        ("trainer=fast", "['trainer=fast']"), ("", "['']"), ({"trainer": "fast"}, "['trainer=fast']"),
        ([1], "trainer=fast"), (None, "trainer=fast"), ([b"trainer=fast"], "trainer=fast"), (3, "trainer=fast"),
    ],
)  # fmt: skip
def test_overrides_are_a_list_of_texts(call, given, fix):
    name = [] if call is sextant.run else ["demo"]
    with pytest.raises(UserError, match=r"^overrides=.* must be a list of texts, each key=value") as caught:
        call(*name, given)
    assert caught.value.fix.startswith(f"For example sextant.{call.__name__}([")
    assert fix.strip("[]") in caught.value.fix
