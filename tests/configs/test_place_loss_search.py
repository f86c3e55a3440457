"""Losses are tuned with equal effort: one search for all of them, and arms that set what it searches."""

import pytest

from sextant.composing.config_files import read_config_file
from sextant.config.schema.searches import dimension
from sextant.runs.outputs_folder import conf_dir

SPACE = read_config_file(conf_dir() / "sweep" / "search_place_loss.yaml")["sweep"]["search"]["space"]
ARMS = read_config_file(conf_dir() / "sweep" / "place_loss_tuned.yaml")["sweep"]["arms"]
LOSSES = ("triplet_ratio", "triplet_margin", "soft_margin", "contrastive", "multi_similarity", "info_nce")


@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_sets_its_loss_and_every_key_of_the_search_to_a_value_of_the_space(arm):
    given = dict(word.split("=") for word in ARMS[arm]["overrides"])
    assert set(given) == {"loss", *SPACE}
    assert given.pop("loss") in LOSSES
    for key, text in given.items():
        found = dimension(SPACE[key])
        assert text in map(str, found.options) if found.options else found.low <= float(text) <= found.high


def test_every_loss_is_an_arm_and_kinds_of_mining_differ_in_nothing_else():
    assert set(LOSSES) <= set(ARMS)
    rest = [[w for w in ARMS[f"margin_{kind}"]["overrides"] if "mining" not in w] for kind in ("random", "semi_hard")]
    assert rest[0] == rest[1] == [w for w in ARMS["triplet_margin"]["overrides"] if "mining" not in w]
