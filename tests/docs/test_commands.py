"""Every command that README and docs tell is understood, and some of them are run."""

import re
import sys

import pytest
from docs_commands import PAGES, ROOT, Command, check, commands_of, documented

from sextant import cli
from sextant.composing.config_files import groups
from sextant.errors import UserError

COMMANDS = documented()


def test_there_are_commands_on_the_pages():
    assert len(COMMANDS) > 90
    pages = {command.page for command in COMMANDS}
    assert pages >= {"README.md", "guide.md", "places.md", "localization.md", "benchmarks.md"}


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_a_documented_command_is_understood(command):
    check(command)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("python train.py trainer.max_epoch=3", "Did you mean trainer.max_epochs=3?"),
        ("python train.py optimizer.lr=nan", "must be a finite number"),
        ("python train.py dataset=mnits", "Did you mean dataset=mnist?"),
        ("python train.py sweep=demo", "without -m"),
        ("python train.py -m sweep=dmeo", "Did you mean sweep=demo?"),
        ("python train.py -m seed=0,1 inhibition=none,push", "inhibition=push: no such option"),
        (
            "python train.py task=localization dataset=pose_folder dataset.folder=<f> 'dataset.map={map: map}'",
            "valid str",
        ),
        ("python evaluate.py run=<run> optimizer.lr=1", "belongs to the trained weights"),
        ("python evaluate.py corruption=gaussian", "run= is missing"),
        ("python predict.py run=<run> inptu=<folder> output=<folder>", "Did you mean input="),
        ("python predict.py run=<run> input=<photos>", "output= of"),
        ("python report.py sweep=gone", "sweep gone: no such thing"),
        ("sextant data rendr dataset=town_city", "sextant data rendr"),
        ("sextant data render dataset=town_city dataset.gone=1", "dataset.gone=1: unknown key"),
        ("sextant frobnicate", "sextant frobnicate"),
        ("python -m benchmarks wrlds", "benchmarks wrlds"),
        ("python -m benchmarks.scale_plan cvs=plan.csv", "Did you mean csv=plan.csv?"),
        ("python -m sextant.corruptions make sett=cifar10_c", "Did you mean set=cifar10_c?"),
        ("make dashbord", "make dashbord"),
        ("rm -r outputs", "command rm -r outputs"),
    ],
)
def test_a_wrong_command_on_a_page_would_be_found(text, said):
    for page in (f"```bash\n{text}   # as told\n```\n", f"As in `{text}`, say."):
        found = commands_of("page.md", page)
        if text.startswith("rm") and not page.startswith("```"):
            assert not found
            continue
        assert found == [Command("page.md", text)]
        with pytest.raises(UserError, match=re.escape(said)):
            check(found[0])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_mistake_that_is_shown_is_told_in_these_words(page, capsys, monkeypatch):
    for command, told in re.findall(r"^\$ (python .*)\n((?:.+\n)+?)```", page.read_text(), re.MULTILINE):
        _, script, *words = command.split()
        monkeypatch.setattr(sys, "argv", [script])
        with pytest.raises(SystemExit):
            cli.run(script.removesuffix(".py"), words)
        assert capsys.readouterr().err == told


def test_the_table_of_groups_lists_every_option():
    """A row of one group that does not abbreviate by dots; those of several refer to a chapter's page."""
    text = (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| (`.*?) \|", text, re.MULTILINE))
    checked = [group for group in rows.keys() & groups().keys() if "..." not in rows[group]]
    assert {"dataset", "trainer", "experiment", "sweep"} <= set(checked)
    for group in checked:
        assert set(groups()[group]) <= set(re.findall(r"`(\w+)`", rows[group])), f"docs/guide.md: {group}"
