"""Commands of an installation without an extra name what to install."""

import re
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest

import sextant
from sextant import cli
from sextant.errors import DISTRIBUTION, EXTRAS, UserError, naming_extras

#: packages whose modules have another name
MODULES = {"vl_convert_python": "vl_convert", "markdown_it_py": "markdown_it", "hydra_core": "hydra", "pyyaml": "yaml"}


@pytest.mark.parametrize(
    ("package", "arguments", "extra"), [("rich", ["train"], "train"), ("shapely", ["data", "gallery"], "worlds")]
)
def test_a_missing_package_is_named_with_the_extra_that_brings_it(package, arguments, extra, capsys, monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda verb, rest: __import__(package))
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SystemExit) as end:
        cli.run(arguments[0], arguments[1:])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert f"sextant {arguments[0]} needs {package}, which is not installed" in said
    assert f"pip install 'sextant-vision[{extra}]'" in said


def test_what_no_extra_brings_is_not_hidden(monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda verb, rest: __import__("no_package_of_ours"))
    with pytest.raises(ModuleNotFoundError, match="no_package_of_ours"):
        cli.run("train", [])


@pytest.mark.parametrize("extra", EXTRAS)
def test_all_packages_of_an_extra_are_known(extra):
    declared = [line for line in requires(DISTRIBUTION) if f"extra == '{extra}'" in line.replace('"', "'")]
    names = [re.match(r"[\w-]+", line)[0].lower().replace("-", "_") for line in declared]
    assert {MODULES.get(name, name) for name in names} <= {*EXTRAS[extra], *EXTRAS["train"]}


@pytest.mark.parametrize("name", ["run", "sweep", "evaluate", "load_results", "report"])
def test_a_call_of_the_library_names_the_extra_too(name, monkeypatch):
    monkeypatch.setitem(sextant.LAZY, name, "module_that_imports_yaml")
    monkeypatch.setitem(sys.modules, "yaml", None)
    monkeypatch.setattr(sextant, "import_module", lambda path: __import__("yaml"))
    with pytest.raises(UserError) as caught:
        getattr(sextant, name)
    assert str(caught.value) == (
        f"sextant.{name} needs yaml, which is not installed\npip install 'sextant-vision[train]'"
    )


def test_so_does_a_package_that_a_run_lacks_only_later(monkeypatch):
    monkeypatch.setitem(sys.modules, "shapely", None)

    @naming_extras("sextant.run")
    def run():
        return __import__("shapely")

    with pytest.raises(
        UserError, match=r"needs shapely, which is not installed\npip install 'sextant-vision\[worlds\]'"
    ):
        run()


def test_the_distribution_is_not_another_projects():
    """On PyPI, ``sextant`` is a tool for Helm: nothing may tell a user to install that."""
    root = Path(__file__).parents[2]
    texts = [*root.glob("*.*"), *root.glob("src/**/*.py"), *root.glob("conf/**/*.yaml"), *root.glob("docs/*.md")]
    wrong = re.compile(r"pip install[^\n]*[ '\"]sextant(?!-vision|\.git|\w)|sextant\[[a-z]|sextant==")
    found = {
        path: wrong.search(path.read_text("utf-8")) for path in texts if path.is_file() and path.name != "CHANGELOG.md"
    }
    assert {str(path): each[0] for path, each in found.items() if each} == {}
