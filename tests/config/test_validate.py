"""Every mistake in a config is told with its key, its value, what is allowed and what to write."""

import copy

import pytest

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.errors import UserError


@pytest.fixture(scope="module")
def composed():
    return to_plain(compose([]))


def mistake(composed, key, value):
    config = copy.deepcopy(composed)
    *parents, last = key.split(".")
    node = config
    for parent in parents:
        node = node[parent]
    node[last] = value
    with pytest.raises(UserError) as caught:
        validate(config)
    return str(caught.value)


def test_the_default_config_is_legal_and_typed(composed):
    config = validate(composed)
    assert config.trainer.max_epochs == composed["trainer"]["max_epochs"]
    assert config.task.name == "classification"


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("optimizer.lr", -1, "optimizer.lr=-1: must be greater than 0. For example optimizer.lr="),
        ("optimizer.lr", "fast", "optimizer.lr='fast': must be a valid number"),
        ("trainer.max_epochs", 2.5, "trainer.max_epochs=2.5: must be a valid integer"),
        ("trainer.max_epochs", True, "trainer.max_epochs=true: must be a valid integer"),
        ("trainer.max_epochs", 0, "greater than or equal to 1"),
        ("trainer.log_every", 1, "greater than or equal to 20"),
        ("trainer.accelerator", "tpu", "must be 'cpu' or 'gpu'"),
        ("backbone.variant", "E", "must be 'A', 'B', 'C' or 'D'"),
        ("task.validation_fraction", 1.0, "must be less than 1"),
        ("seed", -3, "seed=-3"),
        ("paths.outputs", "", "paths.outputs='': must have at least 1 character"),
        ("corruption.corruptions.gaussian.levels", [-1.0], "corruption.corruptions.gaussian.levels.0=-1.0"),
        ("corruption.corruptions.contrast_poisson.levels", [], "at least 1 item"),
        ("corruption.corruptions.gaussian.levels", [0.1, 0.1], "gaussian.levels: values must differ, got [0.1, 0.1]"),
        ("optimizer.lr", float("inf"), "optimizer.lr=inf"),
        ("sweep", {"name": "s", "seeds": 0}, "sweep.seeds: a number of seeds must be at least 1"),
        ("sweep", {"name": "s", "seeds": [1, 1]}, "values must differ"),
        ("inhibition", {"_target_": "sextant.layers.PushPullInhibition", "scale": 0.5}, "inhibition.scale=0.5"),
    ],
)
def test_wrong_values_are_named_with_what_is_allowed(composed, key, value, said):
    assert said in mistake(composed, key, value)


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("trainer.max_epoch", "trainer.max_epochs=7"),
        ("optimizer.lrr", "optimizer.lr=7"),
        ("dataset.siez", "dataset.size=7"),
        ("corruption.corruptions.gaussian.level", "corruption.corruptions.gaussian.levels=7"),
        ("task.split_sed", "task.split_seed=7"),
    ],
)
def test_unknown_keys_are_refused_and_the_nearest_is_offered(composed, key, near):
    assert f"{key}: unknown key. Did you mean {near}?" in mistake(composed, key, 7)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("maps", "filter.support='maps': must be 'map', or a valid number"),
        (-1, "filter.support=-1: must be 'map', or greater than 0"),
        ([1], "filter.support=[1]: must be 'map', or a valid number"),
        ({"a": 1}, "filter.support={'a': 1}: must be 'map', or a valid number"),
    ],
)
def test_a_key_that_may_be_of_several_kinds_is_told_once(value, said):
    localization = to_plain(compose(["task=localization"]))
    assert mistake(localization, "filter.support", value) == f"{said}. For example filter.support=5.0"


def test_all_mistakes_are_told_at_once(composed):
    config = copy.deepcopy(composed)
    config["optimizer"]["lr"] = -1
    config["seed"] = "x"
    config["trainer"]["bogus"] = 1
    with pytest.raises(UserError) as caught:
        validate(config)
    assert len(str(caught.value).splitlines()) == 3


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("optimizer.momentum", 0.0, "optimizer.nesterov=true needs optimizer.momentum above 0"),
        ("trainer.precision", "16-mixed", "trainer.precision=16-mixed needs trainer=gpu"),
        ("tracking.kind", "server", "tracking=server tracking.uri=http://"),
        ("tracking.uri", "http://x", "belongs to tracking=server"),
        ("schedule.at", [0.6, 0.3], "schedule.at must ascend"),
        ("sweep", {"name": "s", "contrasts": {"c": {"treatment": "a", "control": "b"}}}, "names the arm 'a'"),
    ],
)
def test_rules_across_keys(composed, key, value, said):
    assert said in mistake(composed, key, value)


def test_a_part_of_the_users_own_is_legal(composed):
    config = copy.deepcopy(composed)
    config["backbone"] = {"_target_": "my_package.Network", "depth": 3}
    assert validate(config).backbone.target == "my_package.Network"


@pytest.mark.parametrize("value", [3, True, "x", ["x"], []], ids=str)
def test_a_group_that_holds_no_keys_is_told_as_a_mistake(composed, value):
    for group in composed:
        if group not in ("seed", "init_from", "reuse"):
            assert mistake(composed, group, value).startswith(f"{group}=")


@pytest.mark.parametrize("name", [["a", "b"], {"a": 1}, 3, None])
def test_a_task_that_is_none_is_told_with_those_there_are(composed, name):
    with pytest.raises(UserError, match="task=calibration"):
        validate({**composed, "task": {**composed["task"], "name": name}})


def test_an_unknown_key_without_a_value_is_told_too(composed):
    assert "backbon: unknown key. Did you mean backbone" in mistake({**composed, "backbon": None}, "seed", 0)


def test_a_part_of_another_group_is_no_part_of_ones_own(composed):
    told = mistake(composed, "backbone", {"_target_": "sextant.losses.BearingLoss"})
    assert "is not one of task=classification, which takes " in told
    assert "sextant.models.LeNet" in told
