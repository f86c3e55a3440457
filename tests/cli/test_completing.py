"""Completion: whatever is on the line, a shell gets words that may stand there, and never an error."""

import subprocess
import sys

import pytest

from sextant import cli
from sextant.cli import VERBS
from sextant.cli.completing import SCRIPTS, candidates


@pytest.mark.parametrize(
    ("line", "verb", "there"),
    [
        ("sextant ", None, "train"),
        ("sextant ev", None, "evaluate"),
        ("sextant register ", None, "name="),
        ("sextant register tr", None, "tracking=server"),
        ("sextant predict ma", None, "map="),
        ("python predict.py in", "predict", "input="),
        ("python3.11 report.py sw", "report", "sweep="),
        ("./evaluate.py r", "evaluate", "run="),
        ("python evaluate.py run=x corr", "evaluate", "corruption="),
        ("sextant train dataset=di", None, "dataset=digits"),
        ("python train.py optimizer.l", "train", "optimizer.lr="),
        ("sextant evaluate run=x dataset=mn", None, "dataset=mnist"),
    ],
)
def test_what_may_stand_there_is_offered(line, verb, there):
    found = candidates(line, verb, VERBS)
    assert there in found
    begun = line.split(" ")[-1]
    assert all(word.startswith(begun) and word != begun for word in found)


def test_a_key_that_is_given_is_not_offered_again():
    assert "run=" not in candidates("sextant register run=x ", None, VERBS)


@pytest.mark.parametrize("verb", ["-sc", "predict", "train"])
@pytest.mark.parametrize(
    "line",
    ["", " ", "sextant", "sextant nonsense ", "sextant train '", 'python predict.py "a b', "sextant train dataset=[",
     "python", "python predict.py input=$(", "sextant predict \udcff", "sextant train =", "sextant evaluate ~x=",
     "sextant train -m seed=0,1, ", "python train.py ${a", "sextant doctor ", "sextant a=b c=d "],
)  # fmt: skip
def test_nothing_is_an_error(line, verb, capfd, monkeypatch):
    monkeypatch.setenv("COMP_LINE", line)
    cli.run(verb, ["-sc", "query=bash"] if verb != "-sc" else ["query=bash"])
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("shell", SCRIPTS)
def test_a_shell_is_told_how_to_ask(shell, capsys):
    cli.run("-sc", [f"install={shell}"])
    assert f"sextant -sc query={'fish' if shell == 'fish' else 'bash'} 2>/dev/null" in capsys.readouterr().out


def test_bash_completes(tmp_path):
    """The script in a real bash, with a command that answers as ours does."""
    (tmp_path / "sextant").write_text(f"#!{sys.executable}\nfrom sextant.cli import main\nmain()\n")
    (tmp_path / "sextant").chmod(0o755)
    script = (
        f"PATH={tmp_path}:$PATH\n{SCRIPTS['bash']}\n"
        "COMP_LINE='sextant regis'; COMP_POINT=${#COMP_LINE}; _sextant; printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("register\n", "")
