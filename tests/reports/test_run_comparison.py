"""Comparing two runs: what differs, and whether seeds alone make metrics differ so much."""

import numpy as np
import pytest

from sextant import cli
from sextant.atomic_files import write_json
from sextant.errors import UserError
from sextant.reports.run_comparison import compare_runs
from sextant.runs.directory import RunDirectory

LR = {"conv": "0.1", "push_pull": "0.2"}


def run_in(outputs, digest, seed, accuracy, **state):
    run = RunDirectory(outputs / "runs" / "classification" / f"{digest}-s{seed}")
    run.checkpoints.mkdir(parents=True)
    run.last_checkpoint.touch()
    params = {"optimizer.lr": LR[digest], "seed": str(seed)}
    versions = {"versions": {"torch": "2.0"}}
    same = {"task": "classification", "digest": digest, "seed": seed, "code": "c0de", "data": "da7a"}
    run.update_state(same | {"params": params, "provenance": versions} | state)
    write_json(run.metrics, {"outcome": "finished", "metrics": {"accuracy": accuracy, "steps": 5}})
    return run


@pytest.fixture
def arms(tmp_path):
    """Ten seeds of two configs; the second is better by two deviations of a seed."""
    noise = np.random.default_rng(0).normal(size=(2, 10))
    return {
        digest: [run_in(tmp_path, digest, seed, float(shift + noise[k, seed])) for seed in range(10)]
        for k, (digest, shift) in enumerate([("conv", 90.0), ("push_pull", 92.0)])
    }


def of_accuracy(first, second, outputs):
    return next(each for each in compare_runs(first, second, outputs).metrics if each.name == "accuracy")


def test_seeds_of_one_config_differ_within_what_seeds_make(arms, tmp_path):
    pairs = [(a, b) for a in arms["conv"] for b in arms["conv"] if a is not b]
    beyond = [of_accuracy(a, b, tmp_path).beyond_seeds for a, b in pairs]
    assert sum(beyond) <= 0.1 * len(pairs)
    assert of_accuracy(*pairs[0], tmp_path).seeds == 10


def test_a_difference_beyond_seeds_is_told(arms, tmp_path):
    far = run_in(tmp_path, "push_pull", 10, 130.0)
    assert of_accuracy(arms["conv"][0], far, tmp_path).beyond_seeds
    assert of_accuracy(arms["conv"][0], arms["push_pull"][0], tmp_path).seeds == 21


def test_what_differs_is_named(arms, tmp_path):
    other = run_in(tmp_path, "push_pull", 11, 92.0, code="other", provenance={"versions": {"torch": "2.1"}})
    found = compare_runs(arms["conv"][3], other, tmp_path)
    assert found.config == {"optimizer.lr": ("0.1", "0.2"), "seed": ("3", "11")}
    assert found.origin == {"code": ("c0de", "other"), "versions.torch": ("2.0", "2.1")}


def test_without_other_seeds_nothing_is_said_of_them(tmp_path):
    first, second = (run_in(tmp_path, digest, 0, 90.0) for digest in LR)
    found = of_accuracy(first, second, tmp_path)
    assert found.beyond_seeds is None


def test_the_command_shows_it(arms, tmp_path, capsys):
    cli.run("compare", ["run=conv-s0", "run=push_pull-s1", f"outputs={tmp_path}"])
    said = capsys.readouterr().out
    for text in (
        "optimizer.lr",
        "accuracy",
        "20 runs",
        "1 of 2 metrics are the same",
        "code, data, versions: the same",
    ):
        assert text in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run=conv-s0"], "compare needs two runs, got 1"),
        (["run=conv-s0", "run=gone"], "run=gone: no run"),
        (["run=conv-s0", "run=conv-s1", "wiht=x"], "wiht=x"),
    ],
)
def test_mistakes_are_told(arguments, said, arms, tmp_path, capsys):
    from sextant.cli.compare import main

    with pytest.raises(UserError, match=said):
        main([*arguments, f"outputs={tmp_path}"])


@pytest.mark.parametrize("content", [None, "{"])
def test_a_run_without_metrics_is_told(arms, tmp_path, content, capsys):
    metrics = arms["push_pull"][1].metrics
    metrics.unlink() if content is None else metrics.write_text(content)
    with pytest.raises(SystemExit, match="2"):
        cli.run("compare", ["run=conv-s0", "run=push_pull-s1", f"outputs={tmp_path}"])
    said = capsys.readouterr()
    assert f"{metrics} is missing or damaged" in said.err
    assert "optimizer.lr" in said.out
