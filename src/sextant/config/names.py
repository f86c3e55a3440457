"""Import paths of parts that have moved: what configs named them first, and what they are now.

A config may name a part by either path. What is validated and built has the present one; digests are taken with the
first one, so that a run, sweep or checkpoint of an earlier release stays the experiment that it was.

Example:
    >>> with_present_names({"_target_": "sextant.data.places.PlaceFolders", "folder": "photos"})
    {'_target_': 'sextant.chapters.places.data.PlaceFolders', 'folder': 'photos'}
"""

from collections.abc import Mapping
from typing import Any

TARGET = "_target_"
#: present path of a module, package or part by each that it had; of several, its first one comes first
MOVED = {
    "sextant.applications.classification": "sextant.chapters.classification.classifier",
    "sextant.applications.detection": "sextant.chapters.cosfire",
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
    """The present import path of what was once at ``path``, or is there still."""
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
