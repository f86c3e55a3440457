"""Cells of made-up sweeps, stored by blocks and joined: the report is that of the runs."""

import json
import os
import shutil

import numpy as np
import pytest
from made_up_sweep import PROTOCOL, MadeUpRun, made_up_sweep

from sextant.atomic_files import write_json
from sextant.errors import UserError
from sextant.lifecycle.results import sweep_results
from sextant.reports.stored_cells import CELLS, PLAN, VALUES, join_cells, write_cells
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory

WRONG = {"clean": 1, "fog/1": 2, "fog/2": 4, "gaussian/0.1": 3, "gaussian/0.5": 9}
OF_SET = {**PROTOCOL, "severities": {"fog": [1, 2]}}
ARMS = ("none", "first", "first_block", "all")


def made_up(folder, seeds=4, protocol=OF_SET, **definition):
    """Four arms at so many seeds; the last run of ``all`` diverged."""
    rng = np.random.default_rng(0)

    def run(arm, seed):
        wrong = {key: int(count + ARMS.index(arm) + rng.integers(0, 3)) for key, count in WRONG.items()}
        cost = {"multiplications": 100 * (1 + ARMS.index(arm)), "pull_multiplications": 0, "inhibition": {}}
        outcome = "diverged" if (arm, seed) == ("all", seeds - 1) else "finished"
        return MadeUpRun(wrong, outcome, protocol, cost, seconds=10.0 / 3)

    arms = {arm: [run(arm, seed) for seed in range(seeds)] for arm in ARMS}
    results = made_up_sweep(folder, arms, question="Which?", **definition)
    for cell in results.cells:
        directory = RunDirectory(folder / cell.cell.run)
        directory.update_state({"started": 100 + cell.cell.pair})
        directory.config.write_text("{trainer: {max_epochs: 3, batch_size: 128}, optimizer: {lr: 0.1}, seed: 0}")
        write_json(directory.metrics, {**(directory.results() or {}), "epochs": 3, "steps": 1266})
    return sweep_results(results.directory)


def only_of(results, pairs, outputs):
    """The same sweep in another output folder, in which the runs of some pairs alone are there."""
    shutil.copytree(results.directory.parents[1], outputs)
    for cell in results.cells:
        if cell.cell.pair not in pairs:
            shutil.rmtree(outputs / cell.cell.run)
    return sweep_results(results.directory.name, outputs)


def texts(results, outputs):
    """The report's texts; its figures are drawn from the same numbers."""
    paths = [path for path in write_report(results) if path.suffix in (".md", ".csv", ".tex")]
    return {path.name: path.read_text().replace(str(outputs), "") for path in paths}


@pytest.mark.slow
def test_the_report_of_joined_blocks_is_that_of_the_runs(tmp_path):
    whole = made_up(tmp_path / "whole")
    blocks = [(0,), (1, 2), (3,)]
    for number, pairs in enumerate(blocks):
        block = only_of(whole, pairs, tmp_path / f"run{number}")
        assert block.count("missing") == 4 * (4 - len(pairs))
        write_cells(block, tmp_path / f"block{number}")
    folders = ",".join(str(tmp_path / f"block{number}") for number in (2, 0, 1))
    joined = sweep_results(folders, tmp_path / "elsewhere")
    expected = texts(whole, tmp_path / "whole")
    assert texts(joined, tmp_path / "elsewhere") == expected
    assert "1 of 16 runs did not learn.** A run has diverged if its validation accuracy" in expected["report.md"]
    assert "trained for 3 epochs, 1266 steps, at a learning rate of 0.1" in expected["report.md"]
    assert expected["dates.csv"].splitlines()[1] == "1970-01-01T00:01:40+00:00,1970-01-01T00:01:43+00:00"
    assert {"effects.csv", "cost.csv", "corruptions.csv", "seeds.csv"} <= expected.keys()


@pytest.mark.parametrize("protocol", [OF_SET, None])
def test_what_a_block_lacks_is_missing(tmp_path, protocol):
    whole = made_up(tmp_path / "whole", protocol=protocol)
    stored = write_cells(only_of(whole, (1,), tmp_path / "run"), tmp_path / "block")
    joined = sweep_results(stored, tmp_path / "elsewhere")
    assert joined.directory == tmp_path / "elsewhere" / "sweeps" / whole.directory.name
    assert [cell.outcome for cell in joined.of("net", "none")] == ["missing", "finished", "missing", "missing"]
    assert joined.conditions == whole.conditions
    for mine, theirs in zip(joined.cells, whole.cells, strict=True):
        if mine.outcome != "missing":
            assert mine.errors == theirs.errors
            assert all(np.array_equal(images, theirs.values[key]) for key, images in mine.values.items())


def test_configs_and_digests_are_stored_without_seed_or_place(tmp_path):
    whole = made_up(tmp_path / "whole", seeds=1)
    run = RunDirectory(tmp_path / "whole" / whole.cells[1].cell.run)
    run.config.write_text("seed: 0\ninhibition: {where: first}\npaths: {outputs: /home/me}\n")
    run.update_state({"code": "c0de", "data": "da7a"})
    stored = write_cells(sweep_results(whole.directory), tmp_path / "block")
    assert json.loads((stored / PLAN).read_text())["configs"]["net: first"] == {"inhibition": {"where": "first"}}
    head, _, row, *_ = (stored / CELLS).read_text().splitlines()
    assert head.startswith("setting,arm,pair,seed,digest,code,data,outcome,seconds,parameters")
    assert row.startswith("net,first,0,0,first,c0de,da7a,finished,3.33")
    text = (stored / PLAN).read_text() + (stored / CELLS).read_text()
    assert whole.plan.here == os.getcwd()
    assert str(tmp_path) not in text
    assert os.getcwd() not in text


@pytest.mark.slow
def test_joined_blocks_are_stored_with_the_code_data_and_configs_of_their_runs(tmp_path):
    whole = made_up(tmp_path / "whole")
    for cell in whole.cells:
        RunDirectory(tmp_path / "whole" / cell.cell.run).update_state({"code": "c0de", "data": cell.cell.digest})
    folders = [tmp_path / name for name in ("block0", "block1")]
    for folder, pairs in zip(folders, [(0, 1), (2, 3)], strict=True):
        write_cells(only_of(whole, pairs, tmp_path / f"run of {folder.name}"), folder)
    at_once = write_cells(sweep_results(whole.directory), tmp_path / "at once")
    joined = write_cells(join_cells(folders, tmp_path / "elsewhere"), tmp_path / "joined")
    assert ",c0de,first_block,finished," in (joined / CELLS).read_text()
    assert (joined / CELLS).read_text() == (at_once / CELLS).read_text()
    assert json.loads((joined / PLAN).read_text()) == json.loads((at_once / PLAN).read_text())


def truncated(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def edited(old, new):
    def edit(path):
        path.write_text(path.read_text().replace(old, new, 1))

    return edit


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        (PLAN, truncated),
        (PLAN, lambda path: path.write_text("{}")),
        (PLAN, lambda path: path.write_text('{"plan": {}}')),
        (PLAN, lambda path: path.write_text("[]")),
        (CELLS, truncated),
        (CELLS, lambda path: path.unlink()),
        (CELLS, lambda path: path.write_text("")),
        (CELLS, edited("finished", "perfect")),
        (CELLS, edited("net,first", "net,last")),
        (CELLS, edited('""cost""', '""cost')),
        (CELLS, lambda path: path.write_bytes(b"\xff\xfe")),
        (VALUES, truncated),
        (VALUES, lambda path: path.unlink()),
        (VALUES, lambda path: np.savez(path)),
        (VALUES, lambda path: np.savez(path, nothing=np.zeros(3))),
        (VALUES, lambda path: np.savez(path, **{"0/clean": np.array([{}], dtype=object)})),
        (VALUES, lambda path: path.write_bytes(b"")),
    ],
)
def test_damaged_cells_are_refused_by_the_name_of_their_folder(tmp_path, name, damage):
    stored = write_cells(made_up(tmp_path / "whole", seeds=2), tmp_path / "block")
    damage(stored / name)
    with pytest.raises(UserError, match="block does not hold the cells of a sweep, or they are damaged") as refused:
        join_cells([stored], tmp_path)
    assert "cells=<folder>" in refused.value.fix


def test_blocks_of_other_designs_or_with_other_results_are_refused(tmp_path):
    stored = write_cells(made_up(tmp_path / "a"), tmp_path / "block_a")
    other = write_cells(made_up(tmp_path / "b", seeds=3), tmp_path / "block_b")
    with pytest.raises(UserError, match=r"block_b holds made_up-\w+, another design than .*block_a"):
        join_cells([stored, other], tmp_path)
    custom = write_cells(made_up(tmp_path / "c", protocol=None), tmp_path / "block_c")
    with pytest.raises(UserError, match="another design"):
        join_cells([stored, custom], tmp_path)
    again = tmp_path / "again"
    shutil.copytree(stored, again)
    with np.load(again / VALUES) as arrays:
        values = {name: array.copy() for name, array in arrays.items()}
    values["5/clean"] += 1
    np.savez(again / VALUES, **values)
    with pytest.raises(UserError, match="have different results of net first seed 1"):
        join_cells([stored, again], tmp_path)
    assert join_cells([stored, stored], tmp_path).count("finished") == 15
    with pytest.raises(UserError, match="nowhere does not hold the cells"):
        sweep_results(f"{stored},{tmp_path / 'nowhere'}", tmp_path)
