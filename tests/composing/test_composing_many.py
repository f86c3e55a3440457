"""Compositions that share the reading of files are those that each would be alone."""

import pytest
from omegaconf import OmegaConf

from sextant.composing import compose as module
from sextant.composing.compose import compose, composing_many
from sextant.errors import UserError

CHOICES = [
    ["optimizer.lr=0.1"],
    ["optimizer.lr=0.2", "seed=3"],
    ["inhibition=push_pull", "optimizer.lr=0.2"],
    ["optimizer.lr=0.2", "inhibition=push_pull", "inhibition.scale=3"],
    ["task=calibration", "sampling@test_sampling=lopez", "test_sampling.size=[8,8]"],
    ["~inhibition", "trainer.max_epochs=2"],
    ["+sweep.name=x", "++sweep.seeds=[1,2]", "init_from='a,b'"],
    ["sweep=demo", "sweep.seeds=${seed}", "seed=4"],
    ["~trainer.progress", "hydra.job.name=x", "corruption.corruptions.gaussian.levels=[0.1]"],
    ["optimizer.lr=0.1"],
]


def outcome(overrides):
    try:
        return OmegaConf.to_container(compose(overrides), resolve=True)
    except UserError as error:
        return str(error)


@pytest.mark.slow
def test_they_are_the_same():
    alone = [outcome(overrides) for overrides in CHOICES]
    assert sum(isinstance(found, dict) for found in alone) > 6
    with composing_many():
        assert [outcome(overrides) for overrides in CHOICES] == alone
        assert [outcome(overrides) for overrides in reversed(CHOICES)] == alone[::-1]


def test_files_are_read_once_for_each_choice_of_options(monkeypatch):
    read, hydra_compose = [], module.hydra_compose

    def counting(name, overrides):
        read.append(overrides)
        return hydra_compose(name, overrides=overrides)

    monkeypatch.setattr(module, "hydra_compose", counting)
    with composing_many():
        for rate in (0.1, 0.2, 0.3):
            for kind in ("none", "push_pull"):
                assert compose([f"inhibition={kind}", f"optimizer.lr={rate}"]).optimizer.lr == rate
    assert read == [["inhibition=none"], ["inhibition=push_pull"]]


def test_a_mistake_is_told_as_it_is_alone():
    with composing_many():
        compose(["optimizer.lr=0.1"])
        with pytest.raises(UserError, match=r"Did you mean optimizer\.lr=0\.1"):
            compose(["optimizer.rl=0.1"])
