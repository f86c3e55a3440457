"""What is wrong with an override is told in the user's terms."""

import pytest

from sextant.cli.compose import compose, to_plain
from sextant.cli.sweep_plan import check_sweep_overrides
from sextant.errors import UserError


def told(overrides, function=compose):
    with pytest.raises(UserError) as caught:
        function(overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("task=foo", "task=foo: no such option\nOptions: calibration, classification"),
        ("dataset=mnits", "Did you mean dataset=mnist?"),
        ("datset=mnist", "Did you mean dataset=mnist?"),
        ("trainer.max_epoch=3", "Did you mean trainer.max_epochs=3?"),
        ("optimizer.learning_rate=3", "unknown key"),
        ("max_epochs=3", "Did you mean trainer.max_epochs=3?"),
        ("lr", "'lr' is not a key=value override"),
        ("a b=c=[", "is not a key=value override"),
    ],
)
def test_one_wrong_override(override, said):
    assert said in told([override])


def test_the_wrong_one_of_several_is_named():
    assert "backbone=lenet_z" in told(["dataset=digits", "optimizer.lr=0.1", "backbone=lenet_z"])


def test_a_missing_mandatory_value_is_named():
    with pytest.raises(UserError, match=r"dataset\.folder has no default"):
        to_plain(compose(["dataset=image_folder"]))


def test_every_choice_of_a_sweep_is_checked_before_it_is_planned():
    assert "backbone=lenet_z" in told(["backbone=lenet_a,lenet_z", "seed=0,1"], check_sweep_overrides)
