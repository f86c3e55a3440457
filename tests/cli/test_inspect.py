import json
import shlex

import pytest
from applications.inspection.folders import photos

from sextant import cli


def test_a_folder_is_shown_with_commands_to_copy(tmp_path, capsys):
    photos(tmp_path / "my photos", camera=("Apple", "iPhone 12"))
    (tmp_path / "my photos" / "broken.jpg").touch()
    cli.run("inspect", [str(tmp_path / "my photos"), f"json={tmp_path / 'found.json'}"])
    said = capsys.readouterr().out
    assert "3 photos of one camera (Apple iPhone 12)" in said
    assert "Cannot be read (1)" in said
    (command,) = [line for line in said.splitlines() if line.startswith("  sextant predict") and "cosfire" not in line]
    assert shlex.split(command)[2] == f"input={tmp_path / 'my photos'}"
    facts = json.loads((tmp_path / "found.json").read_text())
    assert facts["unreadable"] == {"broken.jpg": "is empty (0 bytes)"}
    assert facts["suggestions"][0]["commands"] == [command.strip()]


def test_a_name_of_any_characters_is_shown_as_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = ["br [x]/a[/b]", "pan o, =", "long " * 40]
    for name in names:
        photos(tmp_path / name, camera=("Apple", "iPhone 12"))
        cli.run("inspect", [name])
        assert capsys.readouterr().out.splitlines()[0] == name


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "input= is missing"),
        (["nowhere"], "input=nowhere does not exist"),
        (["one", "two"], "'two' is not a key=value argument"),
        ([".", "jsn=x"], "Did you mean json=x?"),
        (["<folder>", "json=<folder>"], "must be a file of its own that ends in .json"),
        (["<folder>/notes.txt"], "/notes.txt is empty (0 bytes)"),
        (["<folder>/a.json", "json=<folder>/a.json"], "must be a file of its own that ends in .json"),
    ],
)
def test_mistakes_are_one_message(arguments, said, tmp_path, capsys):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(SystemExit) as ended:
        cli.run("inspect", [word.replace("<folder>", str(tmp_path)) for word in arguments])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
