"""Parts are those that Hydra builds of the same nodes."""

from functools import partial

import pytest
import torch
from frozen import freeze
from hydra.utils import instantiate

from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import groups
from sextant.config.building import build_part, named
from sextant.config.schema.parts import known_targets
from sextant.config.validate import config_classes
from sextant.moved import FIRST, MOVED, present_name, with_first_names, with_present_names

PARTS = [(group, option) for group in ("pooling", "backbone", "inhibition") for option in sorted(groups()[group])]
IMAGES = {"in_channels": 3, "image_size": (96, 128), "num_classes": 8}
FURTHER = {"pooling": {"channels": 8, "size": (4, 6)}, "backbone": IMAGES, "inhibition": {}}


@pytest.mark.parametrize(("group", "option"), PARTS)
def test_what_a_config_names_is_built_as_hydra_builds_it(group, option):
    task = "place_recognition" if group == "pooling" else "classification"
    node = to_plain(compose([f"task={task}", f"{group}={option}"]))[group]
    built = []
    for build in (build_part, lambda node, **given: instantiate(node, _convert_="all", _partial_=True)(**given)):
        torch.manual_seed(0)
        built.append(build(node, **FURTHER[group]))
    ours, theirs = built
    assert type(ours) is type(theirs)
    if isinstance(ours, torch.nn.Module):
        one, other = ours.state_dict(), theirs.state_dict()
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) for name in one)
    else:
        assert vars(ours) == vars(theirs)


FROZEN = freeze.read("names.json")["targets"]


@pytest.mark.parametrize("old", [path for path in FROZEN if present_name(path) != path])
def test_what_stored_configs_name_is_found_where_it_is_today(old):
    new = present_name(old)
    assert named(old) is named(new)
    node = {"motion": [{"_target_": old, "inner": {"_target_": old}}], "name": old}
    now = with_present_names(node)
    assert now == {"motion": [{"_target_": new, "inner": {"_target_": new}}], "name": old}
    assert with_first_names(now) == node
    assert with_present_names(now) == now


def test_a_name_between_the_first_and_the_present_one_is_read_too():
    node = {"_target_": "sextant.recipes.descriptors.DescriptorFiles"}
    assert with_first_names(with_present_names(node)) == {"_target_": "sextant.cli.descriptors.DescriptorFiles"}


def test_what_has_moved_has_one_present_path():
    config_classes()  # the parts of all chapters are known
    assert not FIRST.keys() & MOVED.keys()
    assert all(present_name(path) == path for path in known_targets())
    assert {present_name(path) for path in FROZEN} <= known_targets() | {"numpy.arange", "torch.optim.SGD"}


def test_nodes_within_a_node_are_built_first():
    inner = {"_target_": "fractions.Fraction", "numerator": 1, "denominator": 3}
    node = {"_target_": "builtins.dict", "a": inner, "b": [inner, 2], "c": {"d": inner}, "_partial_": True}
    made = build_part(node, e=5)
    assert isinstance(made, partial)
    third = build_part(inner)
    assert third * 3 == 1
    assert made() == {"a": third, "b": [third, 2], "c": {"d": third}, "e": 5}


@pytest.mark.parametrize(
    "path", ["no_such_module.Thing", "collections.NoSuchThing", "collections.abc.Mapping.none", "x"]
)
def test_a_path_that_leads_nowhere_is_told(path):
    with pytest.raises(ImportError, match=path):
        build_part({"_target_": path})


def test_a_name_within_a_class_is_found():
    assert build_part({"_target_": "datetime.datetime.fromisoformat"} | {"_partial_": True}).func("2000-01-02").day == 2


@pytest.mark.parametrize("path", ["os.system", "torch.os.system", "subprocess.Popen", "builtins.eval", "pickle.loads"])
def test_what_runs_programs_or_code_is_refused_by_whatever_path(path):
    with pytest.raises(ImportError, match=f"{path} is refused"):
        build_part({"_target_": path})
