"""Commands of an installation without an extra name what to install."""

import re
import sys
from importlib.metadata import requires

import pytest

from sextant import cli

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
    assert f"pip install 'sextant[{extra}]'" in said


def test_what_no_extra_brings_is_not_hidden(monkeypatch):
    monkeypatch.setattr(cli, "_run", lambda verb, rest: __import__("no_package_of_ours"))
    with pytest.raises(ModuleNotFoundError, match="no_package_of_ours"):
        cli.run("train", [])


@pytest.mark.parametrize("extra", cli.EXTRAS)
def test_all_packages_of_an_extra_are_known(extra):
    declared = [line for line in requires("sextant") if f"extra == '{extra}'" in line.replace('"', "'")]
    names = [re.match(r"[\w-]+", line)[0].lower().replace("-", "_") for line in declared]
    assert {MODULES.get(name, name) for name in names} <= {*cli.EXTRAS[extra], *cli.EXTRAS["train"]}
