"""Ctrl-C: one line says where the work was and what the same command does, with status 130 and without a traceback."""

import pytest
from support import quick_config

from sextant import cli
from sextant.cli.terminal import TERMINAL
from sextant.console.console import note_reached, reporting_mistakes
from sextant.console.work_progress import Counted, work_progress
from sextant.lifecycle.execute import execute


def render():
    with work_progress("rendering", "images") as progress:
        progress(512, 2048)
        raise KeyboardInterrupt


def sweep():
    with TERMINAL.running() as progress:
        progress(2, 6)
        raise KeyboardInterrupt


def search():
    TERMINAL.settled(3, {"optimizer.lr": "0.1"}, 0.5, "3 seeds")
    sweep()


def predict():
    for number in Counted("calibrating", "photos", ["a", "b", "c"]):
        if number == "b":
            raise KeyboardInterrupt


def write():
    note_reached("map written to", "maps/a")
    list(Counted("describing", "photos", ["a", "b"]))
    raise KeyboardInterrupt


def something_else():
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("verb", "work", "said"),
    [
        ("data", render, "rendering 512/2,048 images. The same command resumes."),
        ("train", sweep, "runs 2/6. The same command resumes."),
        ("train", search, "trial 3 settled, runs 2/6. The same command resumes."),
        ("predict", predict, "calibrating 1/3 photos. The same command starts again."),
        ("predict", write, "map written to maps/a, describing 2/2 photos. The same command starts again."),
    ],
)
def test_where_it_stopped_is_said(verb, work, said, capsys, monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda *_: work())
    with pytest.raises(SystemExit) as ended:
        cli.run(verb, [])
    assert ended.value.code == 130
    assert capsys.readouterr().err == f"Interrupted: {said}\n"


def test_the_next_command_of_the_process_begins_anew(capsys):
    note_reached("runs", "1/2")
    with pytest.raises(SystemExit), reporting_mistakes("train"):
        raise KeyboardInterrupt
    with pytest.raises(SystemExit), reporting_mistakes("train"):
        raise KeyboardInterrupt
    assert capsys.readouterr().err.splitlines()[1] == "Interrupted. The same command resumes."


@pytest.mark.parametrize("verb", ["dashboard", "demo"])
def test_what_is_always_ended_so_ends_silently(verb, capsys, monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda *_: something_else())
    with pytest.raises(SystemExit) as ended:
        cli.run(verb, [])
    assert (ended.value.code, capsys.readouterr().err) == (130, "")


@pytest.mark.slow
def test_training_says_the_epoch(outputs, capsys, monkeypatch):
    from sextant.chapters.classification.task import Classification

    usual = Classification.training_step

    def interrupted(self, batch, batch_idx):
        if self.trainer.current_epoch == 1:
            raise KeyboardInterrupt
        return usual(self, batch, batch_idx)

    monkeypatch.setattr(Classification, "training_step", interrupted)
    config = quick_config(outputs, "trainer.max_epochs=3", "tracking=none", "trainer.progress=true", "seed=77")
    with pytest.raises(SystemExit) as ended, reporting_mistakes("train"):
        execute(config, reporter=TERMINAL)
    assert ended.value.code == 130
    assert "Interrupted: epoch 2/3. The same command resumes." in capsys.readouterr().err
