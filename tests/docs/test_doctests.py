"""The examples of docstrings run, and packages that are complete stay so."""

import doctest
import re
from importlib import import_module
from inspect import getmembers, isclass, isfunction

import pytest
import torch
from docs_commands import ROOT

SOURCE = ROOT / "src"
#: packages all of whose public functions have an example
COMPLETE = (
    "baselines",
    "baselines.calibration",
    "chapters.calibration.figures",
    "chapters.calibration.metrics",
    "chapters.calibration.metrics.doctor",
    "chapters.classification.figures",
    "chapters.cosfire.figures",
    "chapters.localization.figures",
    "chapters.places.figures",
    "chapters.places.match_confidence",
    "chapters.places.metrics",
    "corruptions",
    "corruptions.digital",
    "corruptions.filtering",
    "corruptions.shapes",
    "corruptions.weather",
    "evaluation",
    "evaluation.exported",
    "figures",
    "geometry",
    "layers",
    "layers.cosfire",
    "localization",
    "localization.hyperparameters",
    "localization.initialisation",
    "localization.laser",
    "localization.motion",
    "localization.observation",
    "localization.recovery",
    "localization.resampling",
    "losses",
    "models",
    "models.pooling",
    "retrieval",
    "worlds",
    "zoo",
)
#: packages all of whose public classes that do something have one, too
COMPLETE_CLASSES = (
    "baselines",
    "baselines.calibration",
    "corruptions",
    "evaluation.exported",
    "geometry",
    "layers",
    "layers.cosfire",
    "localization.hyperparameters",
    "localization.initialisation",
    "localization.laser",
    "localization.motion",
    "localization.observation",
    "localization.recovery",
    "localization.resampling",
    "losses",
    "models",
    "models.pooling",
    "retrieval",
)
#: what only shows how a call looks, as it needs a run
SHOWN = re.compile(r">>> (?:.|\n +\.\.\. )*# doctest: \+SKIP")


def runs(path):
    text = path.read_text("utf-8")
    return text.count(">>> ") > len(SHOWN.findall(text))


MODULES = [
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")
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


def public_functions(package):
    """What a package offers, or, where it lists no names, the functions of its modules."""
    offered = import_module(f"sextant.{package}")
    if hasattr(offered, "__all__"):
        return [each for each in (getattr(offered, name) for name in offered.__all__) if isfunction(each)]
    files = sorted((SOURCE / "sextant" / package.replace(".", "/")).glob("[!_]*.py"))
    modules = [import_module(f"sextant.{package}.{file.stem}") for file in files] or [offered]
    found = ((each, module) for module in modules for name, each in getmembers(module, isfunction) if name[0] != "_")
    return [each for each, module in found if each.__module__ == module.__name__]


@pytest.mark.parametrize("package", COMPLETE)
def test_every_public_function_of_a_complete_package_has_an_example(package):
    assert not [each.__name__ for each in public_functions(package) if ">>>" not in (each.__doc__ or "")]


def does_something(kind):
    """Whether people make objects of it to use them: it is neither abstract nor a record that functions return."""
    methods = dict(getmembers(kind, isfunction))
    abstract = any(getattr(method, "__isabstractmethod__", False) for method in methods.values())
    return not abstract and any(not name.startswith("_") for name in methods)


def test_records_and_abstract_classes_need_no_example():
    names = ("CameraLoss", "PlaceLossOutput", "BearingLoss")
    assert [does_something(getattr(import_module("sextant.losses"), name)) for name in names] == [False, False, True]


@pytest.mark.parametrize("package", COMPLETE_CLASSES)
def test_every_public_class_of_a_complete_package_has_an_example(package):
    offered = import_module(f"sextant.{package}")
    classes = [each for each in (getattr(offered, name) for name in offered.__all__) if isclass(each)]
    assert classes
    assert not [each.__name__ for each in classes if does_something(each) and ">>>" not in (each.__doc__ or "")]
