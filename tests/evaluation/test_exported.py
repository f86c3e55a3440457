"""What the package exports lazily is not hidden by a module of its name, which importing it would put in its place."""

import pkgutil

import sextant.evaluation
from sextant.evaluation import exported


def test_no_module_has_the_name_of_something_exported():
    modules = {module.name for module in pkgutil.iter_modules(sextant.evaluation.__path__)}
    assert not modules & set(exported.__all__)


def test_everything_exported_is_found_in_the_package():
    assert all(getattr(sextant.evaluation, name) is getattr(exported, name) for name in exported.__all__)
