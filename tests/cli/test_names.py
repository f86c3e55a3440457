"""Names that users give: too long, of other characters, or of files where folders belong; one line for each.

The boundaries: the longest name of a file system (255 bytes) and what Sextant adds to it; letters of several bytes;
separators and dots; a file where a folder belongs; each key that becomes a file's name or a path.
"""

import pytest

from sextant import cli
from sextant.applications.arguments import make_folder
from sextant.atomic_files import write_json
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.photo_files import file_stems
from sextant.errors import UserError
from sextant.lifecycle.registering import register_run

LONG = "x" * 300


@pytest.mark.parametrize(
    "name",
    ["", " ", "a b", "a/b", "/a", "a:b", "..", ".a", "-a", "\u00e4", "a\nb", "a\n", "a%b", "'a'", 'a"b', "a\\b",
     "\U0001f600", "a,b", "x" * 201, LONG],
)  # fmt: skip
def test_a_model_cannot_be_registered_so_and_the_store_is_not_touched(name, tmp_path):
    with pytest.raises(UserError) as caught:
        register_run("no-run", name, tmp_path)
    assert caught.value.problem.startswith("name=")
    assert "must be 1 to 200 letters" in caught.value.problem
    assert len(caught.value.problem) < 250
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a", "a.b", "A_1-2.3", "0", "x" * 200])
def test_a_name_that_is_allowed_gets_as_far_as_the_run(name, tmp_path):
    with pytest.raises(UserError, match="run=no-run: no run"):
        register_run("no-run", name, tmp_path)


@pytest.mark.parametrize(
    ("verb", "arguments"),
    [
        ("inspect", [LONG]),
        ("report", [f"sweep={LONG}"]),
        ("register", [f"run={LONG}", "name=a"]),
        ("evaluate", [f"run={LONG}"]),
        ("predict", [f"input={LONG}", "output=x"]),
        ("predict", [f"run={LONG}", "input=.", "output=x"]),
        ("localize", [f"map={LONG}", "input=."]),
        ("export", [f"run={LONG}"]),
        ("compare", [f"run={LONG}", "run=x"]),
        ("sweep", ["status", LONG]),
        ("train", [f"init_from={LONG}"]),
        ("train", ["dataset=image_folder", f"dataset.folder={LONG}"]),
        ("train", [f"paths.outputs={LONG}"]),
        ("train", ["--config-dir", LONG]),
    ],
)
def test_a_name_of_300_characters_is_one_message(verb, arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path / "outputs"))
    with pytest.raises(SystemExit) as ended:
        cli.run(verb, arguments)
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert said.startswith("Error: ")
    assert len(said.splitlines()) <= 2


@pytest.mark.parametrize("key", ["tracking.experiment", "sweep.name"])
def test_names_in_a_config_have_a_limit(key):
    raw = to_plain(compose(["sweep=demo"] if key == "sweep.name" else []))
    node, name = key.split(".")
    with pytest.raises(UserError, match=rf"{key}='x*': must have at most [25]00 characters"):
        validate({**raw, node: {**raw[node], name: "x" * 501}})


@pytest.mark.parametrize("name", ["grey.png", "grey.png/inside", LONG, "\u00e4" * 200, "a/" * 3000])
def test_a_folder_that_cannot_be_made_is_one_message(name, tmp_path):
    (tmp_path / "grey.png").write_text("a picture")
    with pytest.raises(UserError, match=r"^folder=.* is not a folder that can be written to: ") as caught:
        make_folder("folder", tmp_path / name)
    assert "255 bytes" in caught.value.fix or "For example folder=" in caught.value.fix


@pytest.mark.parametrize("name", ["x" * 251 + ".csv", "\u00e4" * 125 + ".csv", "x" * 255])
def test_a_file_of_the_longest_name_is_written_atomically(name, tmp_path):
    write_json(tmp_path / name, {"a": 1})
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_the_results_of_photos_of_long_names_have_names_of_their_own(tmp_path):
    paths = [tmp_path / f"{'x' * 240}{number}.jpg" for number in range(3)] + [tmp_path / ("\u00e4" * 120 + ".png")]
    stems = file_stems(paths)
    assert len(set(stems)) == 4
    assert all(len(f"{stem}_undistorted_overlay.png".encode()) < 255 for stem in stems)
    assert file_stems([tmp_path / "a.jpg", tmp_path / "a.png"]) == ["a", "a_png"]
    assert file_stems([tmp_path / "a.jpg", tmp_path / "All.jpg"], ["all"]) == ["a", "All_jpg"]
