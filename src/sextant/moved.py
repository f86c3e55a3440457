"""Import paths that have moved, with their first and their present names.

A config may name a part by either path. What is validated and built has the present one; digests are taken with the
first one, so that a run, sweep or checkpoint of an earlier release remains the same experiment. A program may
also import a module by its old path.

Example:
    >>> with_present_names({"_target_": "sextant.data.places.PlaceFolders", "folder": "photos"})
    {'_target_': 'sextant.chapters.places.data.PlaceFolders', 'folder': 'photos'}
"""

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType
from typing import Any

TARGET = "_target_"
#: present path of a module, package or part by each that it had; of several, its first one comes first
MOVED = {
    "sextant.applications.classification": "sextant.chapters.classification.classifier",
    "sextant.applications.classification.classifier": "sextant.chapters.classification.classifier",
    "sextant.applications.detection": "sextant.chapters.cosfire",
    "sextant.applications.detection.network": "sextant.chapters.cosfire.network_image",
    "sextant.applications.detection.options": "sextant.chapters.cosfire.detector_options",
    "sextant.applications.inspection": "sextant.tools.inspection",
    "sextant.cli.descriptors": "sextant.chapters.places.descriptors",
    "sextant.data.calibration": "sextant.chapters.calibration.data",
    "sextant.data.localization": "sextant.chapters.localization.data",
    "sextant.data.places": "sextant.chapters.places.data",
    "sextant.evaluation.calibration": "sextant.chapters.calibration.metrics",
    "sextant.localization.motion.spacing.motion_of_spacing": "sextant.localization.motion.motion_of_spacing",
    "sextant.models.pooling.cells_and_vlad.CellsAndVLAD": "sextant.models.pooling.CellsAndVLAD",
    "sextant.recipes.descriptors": "sextant.chapters.places.descriptors",
    "sextant.tasks.schedules": "sextant.training.schedules",
}
FIRST = {present: first for first, present in reversed(MOVED.items())}


def present_name(path: str) -> str:
    """The present import path of what ``path`` names or once named."""
    return _moved(path, MOVED)


def with_present_names(config: Any) -> Any:
    """A config, or a part of one, whose parts have their present import paths."""
    return _renamed(config, MOVED)


def with_first_names(config: Any) -> Any:
    """A config, or a part of one, whose parts have the import paths that they had first."""
    return _renamed(config, FIRST)


def _moved(path: str, names: Mapping[str, str]) -> str:
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        if (found := names.get(".".join(parts[:length]))) is not None:
            return ".".join([found, *parts[length:]])
    return path


def _renamed(node: Any, names: Mapping[str, str]) -> Any:
    if isinstance(node, Mapping):
        changed = {key: _renamed(value, names) for key, value in node.items()}
        target = changed.get(TARGET)
        return {**changed, TARGET: _moved(target, names)} if isinstance(target, str) else changed
    return [_renamed(value, names) for value in node] if isinstance(node, list) else node


class _Present(Loader):
    """Loads the module at the present path as the one at an old path."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(present_name(spec.name))
        self.own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self.own  # the import system has just put that of the old path there


class OldPaths(MetaPathFinder):
    """Finds modules by their paths in earlier releases, if no other finder succeeds."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module that once had this path; None if there is none."""
        return spec_from_loader(name, _Present()) if present_name(name) != name else None


def keep_old_paths() -> None:
    """Let old paths be imported in this process."""
    if not any(isinstance(finder, OldPaths) for finder in sys.meta_path):
        sys.meta_path.append(OldPaths())
