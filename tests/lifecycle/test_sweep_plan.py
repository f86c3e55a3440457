"""Plans of sweeps: arms and seeds of some settings alone, blocks, and small forms."""

from itertools import pairwise

import pytest
from hydra.core.global_hydra import GlobalHydra
from support import Hears

from sextant.errors import UserError
from sextant.lifecycle.sweep_plan import make_plan, sweep_words

FACTORED = """\
# @package _global_
# A sweep for these tests.
sweep:
  name: made_up
  quick: [sweep.seeds=2, trainer.max_epochs=1]
  factors: {backbone: [lenet_a, lenet_b]}
  arms:
    none: {overrides: [inhibition=none]}
    first: {overrides: [inhibition=first]}
    twin: {overrides: [inhibition=twin], only: [lenet_a], seed_offset: 100}
  seeds: 4
  seeds_of: {lenet_b: 3}
"""


@pytest.fixture
def own(tmp_path):
    """The words that choose a folder of configs with this sweep."""
    from sextant.composing.config_files import own_configs

    GlobalHydra.instance().clear()
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "made_up.yaml").write_text(FACTORED)
    with own_configs(tmp_path):
        yield ["sweep=made_up", "dataset=digits", f"paths.outputs='{tmp_path}'"]


def cells(entries):
    return [(entry.cell.setting, entry.cell.arm, entry.cell.pair) for entry in entries]


def test_an_arm_may_belong_to_some_settings_and_a_setting_may_have_fewer_seeds(own):
    _, planned, _ = make_plan(own)
    found = cells(planned)
    assert found[8:12] == [("lenet_a", "twin", pair) for pair in range(4)]
    assert found[12:] == [("lenet_b", arm, pair) for arm in ("none", "first") for pair in range(3)]
    assert [entry.cell.seed for entry in planned][8:12] == [100, 101, 102, 103]
    _, fewer, _ = make_plan([*own, "sweep.seeds=[7,9]"])
    assert [entry.cell.seed for entry in fewer if entry.cell.setting == "lenet_b"] == [7, 9] * 2


def test_intervals_of_an_earlier_version_are_still_read(own):
    _, _, config = make_plan([*own, "+sweep.interval=bootstrap"], hears := Hears())
    assert config.sweep.interval == "bootstrap"
    assert hears.said == ["sweep.interval=bootstrap has no effect: all intervals of reports are Student's t."]


def planned_of_the_demo(outputs, *words):
    GlobalHydra.instance().clear()
    return [entry.cell for entry in make_plan(["sweep=demo", *words, f"paths.outputs='{outputs}'"])[1]]


def test_the_command_line_fixes_a_factor_and_the_seed(tmp_path):
    found = planned_of_the_demo(tmp_path, "backbone=lenet_c", "seed=5")
    assert {(cell.setting, cell.seed) for cell in found} == {("lenet_c", 5), ("lenet_c", 1005)}


def test_arms_shift_their_seeds(tmp_path):
    found = planned_of_the_demo(tmp_path, "sweep.seeds=1")
    assert {(cell.arm, cell.pair, cell.seed) for cell in found} == {
        ("conv", 0, 0),
        ("push_pull", 0, 0),
        ("twin", 0, 1000),
    }


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_blocks_are_a_partition_with_whole_pairs_and_one_plan(own, count):
    whole, planned, _ = make_plan(own)
    blocks = []
    for number in range(1, count + 1):
        plan, block, _ = make_plan(sweep_words([*own, f"sweep.block={number}/{count}"]))
        assert plan.digest == whole.digest
        assert "block" not in plan.definition
        blocks.append(cells(block))
    assert sorted(cell for block in blocks for cell in block) == sorted(cells(planned))
    for block in blocks:
        for setting, arms in (("lenet_a", {"none", "first", "twin"}), ("lenet_b", {"none", "first"})):
            for pair in {pair for at, _, pair in block if at == setting}:
                assert {arm for at, arm, seed in block if (at, seed) == (setting, pair)} == arms
    for before, after in pairwise(blocks):  # the seeds in their order, whatever the setting
        assert max(pair for _, _, pair in before) <= min(pair for _, _, pair in after)


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("sweep.block=0/2", "must be k/n"),
        ("sweep.block=1", "sweep.block: 1 must be k/n"),
        ("sweep.block=3/2", "must be k/n"),
        ("sweep.block=2", "For example sweep.block=1/4"),
        ("sweep.block=1/2/3", "must be k/n"),
        ("sweep.block=-1/2", "must be k/n"),
        ("sweep.block=a/b", "must be k/n"),
        ("sweep.block=", "block"),
        ("sweep.block=1/8", "7 settings and seeds, too few for 8 blocks"),
        ("sweep.seeds_of.lenet_b=0", "seeds_of"),
        ("sweep.seeds_of={lenet_c:3}", "seeds_of.lenet_c names lenet_c; factors have the values lenet_a, lenet_b"),
        ("sweep.arms.twin.only=[lenet_d]", "arms.twin.only names lenet_d"),
        ("sweep.arms.twin.only=lenet_a", "only"),
    ],
)
def test_mistakes_are_refused_in_one_message(own, word, says):
    with pytest.raises(UserError) as refused:
        make_plan(sweep_words([*own, f"++{word}" if "seeds_of={" in word else word]))
    assert says in str(refused.value)


def test_arms_of_other_settings_alone_leave_nothing_to_run(own):
    with pytest.raises(UserError, match="no arm runs in any of its settings"):
        make_plan([*own, "backbone=lenet_b", "~sweep.arms.none", "~sweep.arms.first"])


def test_the_small_form_goes_before_what_is_given(own):
    words = sweep_words([*own, "preset=quick"])
    assert words == [own[0], "sweep.seeds=2", "trainer.max_epochs=1", *own[1:]]
    assert sweep_words([*own, "preset=quick", "sweep.seeds=3"])[1:2] == ["trainer.max_epochs=1"]
    assert sweep_words([*own, "preset=full"]) == own
    _, planned, config = make_plan(words)
    assert (len(planned), config.trainer.max_epochs) == (10, 1)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["preset=quick"], "preset= sets the size of a named sweep"),
        (["preset=quick", "backbone=lenet_a,lenet_b"], "preset= sets the size of a named sweep"),
        (["sweep=demo", "preset=small"], "preset=small sweep=demo: preset= sets"),
        (["sweep=demo", "preset="], "preset= sets the size"),
        (["sweep=cosfire_fewshot", "preset=quick"], "no quick form"),
    ],
)
def test_a_preset_that_there_is_not_is_refused(words, says):
    GlobalHydra.instance().clear()
    with pytest.raises(UserError) as refused:
        sweep_words(words)
    assert says in str(refused.value)
    assert refused.value.fix
