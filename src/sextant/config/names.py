"""Import paths of parts that have moved: what configs named them first, and what they are now.

A config may name a part by either path. What is validated and built has the present one; digests are taken with the
first one, so that a run, sweep or checkpoint of an earlier release stays the experiment that it was.

Example:
    >>> with_present_names({"_target_": "sextant.models.pooling.cells_and_vlad.CellsAndVLAD", "clusters": 4})
    {'_target_': 'sextant.models.pooling.CellsAndVLAD', 'clusters': 4}
"""

from collections.abc import Mapping
from typing import Any

TARGET = "_target_"
#: present path of each part by its first one
MOVED = {
    "sextant.cli.descriptors.DescriptorFiles": "sextant.recipes.descriptors.DescriptorFiles",
    "sextant.cli.descriptors.TrainedDescriptor": "sextant.recipes.descriptors.TrainedDescriptor",
    "sextant.localization.motion.spacing.motion_of_spacing": "sextant.localization.motion.motion_of_spacing",
    "sextant.models.pooling.cells_and_vlad.CellsAndVLAD": "sextant.models.pooling.CellsAndVLAD",
}
FIRST = {present: first for first, present in MOVED.items()}


def with_present_names(config: Any) -> Any:
    """A config, or a part of one, whose parts have their present import paths."""
    return _renamed(config, MOVED)


def with_first_names(config: Any) -> Any:
    """A config, or a part of one, whose parts have the import paths that they had first."""
    return _renamed(config, FIRST)


def _renamed(node: Any, names: Mapping[str, str]) -> Any:
    if isinstance(node, Mapping):
        changed = {key: _renamed(value, names) for key, value in node.items()}
        target = changed.get(TARGET)
        return {**changed, TARGET: names.get(target, target)} if isinstance(target, str) else changed
    return [_renamed(value, names) for value in node] if isinstance(node, list) else node
