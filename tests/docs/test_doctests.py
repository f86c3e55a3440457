"""The examples of docstrings run, and packages that are complete stay so."""

import doctest
import re
from importlib import import_module
from inspect import isfunction

import pytest
import torch
from docs_commands import ROOT

SOURCE = ROOT / "src"
#: packages all of whose public functions have an example
COMPLETE = ("baselines", "corruptions", "geometry", "layers", "layers.cosfire", "retrieval")
#: what only shows how a call looks, as it needs a run
SHOWN = re.compile(r">>> (?:.|\n +\.\.\. )*# doctest: \+SKIP")


def runs(path):
    text = path.read_text("utf-8")
    return text.count(">>> ") > len(SHOWN.findall(text))


MODULES = [
    ".".join(path.relative_to(SOURCE).with_suffix("").parts)
    for path in sorted((SOURCE / "sextant").rglob("*.py"))
    if runs(path)
]


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name):
    torch.manual_seed(0)
    module = import_module(name)
    found = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > 0
    assert found.failed == 0


@pytest.mark.parametrize("package", COMPLETE)
def test_every_public_function_of_a_complete_package_has_an_example(package):
    offered = import_module(f"sextant.{package}")
    functions = [getattr(offered, name) for name in offered.__all__ if isfunction(getattr(offered, name))]
    assert not [each.__name__ for each in functions if ">>>" not in (each.__doc__ or "")]
