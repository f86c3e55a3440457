"""Searches from their command line to what they found; the runs are made up, all else is real."""

import math
import re
import sqlite3

import numpy as np
import pytest
from made_up_search import SPACE, Killed, MadeUpRuns, arguments, made_up_search

from sextant.atomic_files import read_json
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.lifecycle.checks import checked
from sextant.lifecycle.execute import run_digest
from sextant.lifecycle.results import report, sweep_results
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.search.run import sweep_or_search
from sextant.reports.contrasts import contrasts
from sextant.reports.search_results import metric_of_test, search_results
from sextant.runs.directory import all_runs
from sextant.runs.sweep_directory import find_sweep, read_plan


def found_in(outputs):
    return search_results(sweep_results("search", outputs))


def trials_of(outputs):
    """What was tried, and how it went."""
    return [(trial.setting, trial.values, trial.state) for trial in found_in(outputs).trials]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A search that nothing disturbed, with where it is and the runs that it made."""
    outputs, runs = tmp_path_factory.mktemp("whole"), MadeUpRuns()
    return made_up_search(outputs, runs=runs, trials=12), outputs, runs


def test_a_search_tries_as_many_points_as_it_was_told_and_tests_the_best_at_fresh_seeds(whole):
    outcome, outputs, runs = whole
    found = found_in(outputs)
    assert len(found.trials) == 12
    assert {cell.seed for cell in outcome.cells} == {0, 1, 2, 1002, 1003, 1004}
    assert found.winner.mean == max(trial.mean for trial in found.trials if len(trial.values) == 3)
    assert found.winner.state == "all seeds"
    assert len(found.fresh) == 3
    assert found.winners_tested == 1
    assert len(runs.made) == len(set(runs.made)) == len(outcome.cells) == outcome.count("finished")
    assert len(runs.made) < 12 * 3  # some were raced out
    assert set(found.importances) == {"optimizer.lr", "optimizer.momentum"}
    assert sum(found.importances.values()) == pytest.approx(1)


def test_a_run_of_a_trial_is_the_run_that_one_would_make_by_hand(whole):
    outcome, outputs, _ = whole
    cell = outcome.cells[0]
    words = [f"{key}={text}" for key, text in cell.factors.items()]
    config = checked(to_plain(compose([*words, f"seed={cell.seed}", "tracking=none", f"paths.outputs={outputs}"])))
    assert run_digest(config) == cell.digest
    assert f"{cell.digest[:8]}-s{cell.seed}" == outcome.outcomes[0].directory.name


def test_the_same_command_again_runs_nothing_and_more_trials_are_added_to_those_there_are(whole, tmp_path):
    first, again, more = MadeUpRuns(), MadeUpRuns(), MadeUpRuns()
    made_up_search(tmp_path, runs=first)
    before = trials_of(tmp_path)
    outcome = made_up_search(tmp_path, runs=again)
    assert again.made == []
    assert all(each.reused for each in outcome.outcomes)
    assert trials_of(tmp_path) == before
    made_up_search(tmp_path, runs=more, trials=12)
    settings = [setting for setting, _, _ in trials_of(tmp_path)]
    assert settings[:8] == [setting for setting, _, _ in before]
    assert settings == [setting for setting, _, _ in trials_of(whole[1])]
    assert not set(more.made) & set(first.made)


@pytest.mark.parametrize(
    "method", ["tpe", *(pytest.param(name, marks=pytest.mark.slow) for name in ("cmaes", "grid", "halving"))]
)
def test_a_search_killed_five_times_ends_as_if_it_had_not_been(method, tmp_path):
    space = ("optimizer.lr=choice(0.003,0.01,0.03)", "optimizer.momentum=0.5,0.8") if method == "grid" else SPACE
    expected, made, dies = MadeUpRuns(), [], np.random.default_rng(0)
    trials = {"grid": 6, "tpe": 13}.get(method, 8)  # of which the last are not at random any more
    how = {"method": method, "space": space, "trials": trials}
    made_up_search(tmp_path / "whole", runs=expected, **how)
    for _ in range(5):
        runs = MadeUpRuns(dies_after=int(dies.integers(0, 4)))
        with pytest.raises(Killed):
            made_up_search(tmp_path / "killed", runs=runs, **how)
        made += runs.made
    runs = MadeUpRuns()
    made_up_search(tmp_path / "killed", runs=runs, **how)
    assert trials_of(tmp_path / "killed") == trials_of(tmp_path / "whole")
    assert [*made, *runs.made] == expected.made
    assert len(all_runs(tmp_path / "killed")) == len(expected.made)
    assert len(found_in(tmp_path / "whole").trials) == trials


@pytest.mark.slow
def test_a_search_whose_storage_is_lost_asks_for_the_same_trials_and_finds_their_runs(whole, tmp_path):
    made_up_search(tmp_path, trials=13)
    before = trials_of(tmp_path)
    (find_sweep("search", tmp_path) / "study.db").unlink()
    runs = MadeUpRuns()
    made_up_search(tmp_path, runs=runs, trials=13)
    assert runs.made == []
    assert trials_of(tmp_path) == before


@pytest.mark.slow
def test_a_kill_while_a_trial_is_asked_for_leaves_one_that_is_completed(tmp_path):
    made_up_search(tmp_path / "whole", trials=3)
    made_up_search(tmp_path / "killed", trials=2)
    database = find_sweep("search", tmp_path / "killed") / "study.db"
    made_up_search(tmp_path / "killed", trials=3, runs=MadeUpRuns())
    with sqlite3.connect(database) as connection:  # as if the process had died after the first value of the last trial
        last = connection.execute("SELECT max(trial_id) FROM trials").fetchone()[0]
        connection.execute("UPDATE trials SET state='RUNNING', datetime_complete=NULL WHERE trial_id=?", (last,))
        connection.execute("DELETE FROM trial_values WHERE trial_id=?", (last,))
        connection.execute("DELETE FROM trial_params WHERE trial_id=? AND param_name='optimizer.momentum'", (last,))
    made_up_search(tmp_path / "killed", trials=3)
    assert trials_of(tmp_path / "killed") == trials_of(tmp_path / "whole")


@pytest.mark.slow
def test_diverged_and_failed_trials_are_reported_as_such_and_never_win(tmp_path):
    runs = MadeUpRuns(diverges=lambda rate: rate > 0.02, fails=lambda rate: rate < 0.001)
    outcome = made_up_search(tmp_path, runs=runs, trials=12, method="random")
    found = found_in(tmp_path)
    for trial in found.trials:
        rate = float(trial.setting["optimizer.lr"])
        assert (trial.state == "diverged") == (rate > 0.02)
        assert (trial.state == "failed") == (rate < 0.001)
        assert (trial.why == "RuntimeError: no memory") == (rate < 0.001)
        assert bool(trial.values) == (0.001 <= rate <= 0.02)
    assert {trial.state for trial in found.trials} >= {"diverged", "failed", "all seeds"}
    assert 0.001 < float(found.winner.setting["optimizer.lr"]) < 0.02
    assert outcome.count("failed") == sum(trial.state == "failed" for trial in found.trials)  # one run of each
    again = MadeUpRuns(diverges=lambda rate: rate > 0.02)
    assert made_up_search(tmp_path, runs=again, trials=12, method="random").count("failed") == 0
    assert again.made  # what failed was tried again


@pytest.mark.slow
def test_a_search_without_any_result_has_no_winner_and_says_so(tmp_path):
    made_up_search(tmp_path, trials=3, runs=MadeUpRuns(diverges=lambda rate: True))
    found = found_in(tmp_path)
    assert (found.winner, found.fresh, found.importances) == (None, (), {})
    report(find_sweep("search", tmp_path), tmp_path, track=False)
    assert "there is none" in (find_sweep("search", tmp_path) / "report" / "report.md").read_text()


@pytest.mark.slow
def test_less_is_better_where_that_is_said(tmp_path):
    more = (
        "sweep.search.metric=val/loss",
        "sweep.search.direction=minimize",
        "sweep.search.test_metric=test/accuracy/clean",
    )
    made_up_search(tmp_path, *more, trials=12)
    found = found_in(tmp_path)
    assert found.winner.mean == min(trial.mean for trial in found.trials if len(trial.values) == 3)
    assert found.winner.mean < 0.2


@pytest.mark.slow
def test_a_metric_that_the_report_lacks_is_missed_after_the_first_run(tmp_path):
    runs = MadeUpRuns()
    with pytest.raises(UserError, match=r"test_metric=test/success: the runs have no such metric") as problem:
        made_up_search(tmp_path, "sweep.search.test_metric=test/success", runs=runs, trials=5)
    assert "test/accuracy/clean" in str(problem.value)
    assert len(runs.made) == 1
    made_up_search(tmp_path, runs=runs, trials=5)  # goes on, and makes no run twice
    assert len(set(runs.made)) == len(runs.made) > 1


@pytest.mark.parametrize(
    ("metrics", "found"),
    [
        (["val/accuracy", "test/accuracy/svm"], "test/accuracy/svm"),
        (["test/accuracy/svm", "test/accuracy/clean"], "test/accuracy/clean"),
        (["test/accuracy/svm", "test/accuracy"], "test/accuracy"),
        (["test/accuracy/svm", "test/accuracy/knn", "test/loss"], "test/accuracy/svm, test/accuracy/knn$"),
        (["val/accuracy"], "they have none"),
    ],
)
def test_the_test_metric_is_the_counterpart_or_the_one_part_of_it(metrics, found):
    search = {"metric": "val/accuracy", "test_metric": None}
    if found in metrics:
        assert metric_of_test(search, metrics) == found
    else:
        with pytest.raises(UserError, match=found):
            metric_of_test(search, metrics)


@pytest.mark.slow
def test_without_racing_all_trials_get_all_seeds(tmp_path):
    made_up_search(tmp_path, "sweep.search.race=false", trials=5)
    assert [len(values) for _, values, _ in trials_of(tmp_path)] == [3] * 5


@pytest.mark.slow
def test_several_runs_are_started_together(tmp_path):
    batches = []

    class Batches(MadeUpRuns):
        def __call__(self, cells):
            batches.append(len(cells))
            return super().__call__(cells)

    made_up_search(tmp_path, "sweep.search.parallel=4", runs=Batches())
    assert batches[0] == 4
    assert len(found_in(tmp_path).trials) == 8


def test_keys_that_list_values_are_choices_and_a_key_with_one_value_is_not_searched(tmp_path):
    design, _ = read_search(arguments(tmp_path, "inhibition=none,push_pull", "optimizer.nesterov=choice(true,false)"))
    assert design.search.space["inhibition"] == "choice(none,push_pull)"
    assert design.space["optimizer.nesterov"].options == ("True", "False")
    same, _ = read_search(arguments(tmp_path, "optimizer.nesterov=true", "sweep.name=other"))
    assert set(same.space) == {"optimizer.lr", "optimizer.momentum"}
    assert same.name == "other"


@pytest.mark.slow
def test_how_many_trials_there_are_does_not_make_it_another_search(tmp_path):
    digests = {
        read_search(arguments(tmp_path, *more, trials=n))[0].digest
        for n, more in ((5, ()), (9, ("sweep.search.race=false",)))
    }
    assert len(digests) == 1
    others = [("optimizer.weight_decay=0",), ("sweep.search.sampler_seed=1",), ("dataset=mnist",)]
    assert len(digests | {read_search(arguments(tmp_path, *more))[0].digest for more in others}) == 4


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["optimizer.lr=log_uniform(1e-4)"], "log_uniform needs two bounds, such as log_uniform(1e-4, 1e-1)"),
        (["optimizer.lr=uniform()"], "uniform needs two bounds"),
        (["optimizer.lr=uniform(0.1, 0.01)"], "the bounds must be finite, the lower one first"),
        (["optimizer.lr=uniform(0, inf)"], "the bounds must be finite"),
        (["optimizer.lr=log_uniform(0, 1)"], "a logarithm needs bounds above 0"),
        (["optimizer.lr=uniform(low, high)"], "the bounds of uniform are numbers"),
        (["trainer.batch_size=int(1.5, 8)"], "the bounds of int are whole numbers"),
        (["optimizer.lr=uniform(-1, 1)"], "optimizer.lr=0.0: must be greater than 0"),
        (["optimizer.lrr=uniform(0.1, 1)"], "Did you mean optimizer.lr"),
        (["inhibition=none,pushpull"], "inhibition=pushpull: no such option"),
        ([], "sweep.search.space is empty"),
        (["sweep.search=tpee", *SPACE], "sweep.search.method='tpee'"),
        (["sweep.search=grid", *SPACE], "a grid needs a finite number of values"),
        (["sweep.search=cmaes", "optimizer.lr=uniform(0.1, 1)"], "needs two numbers or more"),
        (["sweep.search=cmaes", *SPACE, "inhibition=none,push_pull"], "no choice"),
        (["sweep.search.metric=test/accuracy", *SPACE], "a search uses the validation split alone"),
        (["sweep.search.metric=val/loss", *SPACE], "its direction is unknown"),
        (["sweep.search.n_trials=0", *SPACE], "sweep.search.n_trials=0"),
        (["sweep.search.trials=9", *SPACE], "sweep.search.trials: unknown key"),
        (["sweep.search.fresh_seeds=[1,9]", "sweep.seeds=3", *SPACE], "the winner is chosen at these"),
        (["sweep.search.fresh_seeds=[1,9]", "seed=0,1", *SPACE], "sweep.search.fresh_seeds contains one of these"),
        (["sweep.search.storage=mysql://here", *SPACE], "sweep.search.storage='mysql://here'"),
        (["sweep=demo", *SPACE], "it cannot be combined with factors, arms, contrasts or worlds"),
    ],
)
def test_a_wrong_search_is_refused_before_anything_is_run(given, said, tmp_path):
    method = [] if any(word.startswith("sweep.search=") for word in given) else ["sweep.search=random"]
    with pytest.raises(UserError, match=re.escape(said)):
        sweep_or_search([*method, *given, f"paths.outputs={tmp_path}", "tracking=none"], run_cells=pytest.fail)


def test_a_range_without_a_search_is_refused_with_the_way_to_search_it(tmp_path):
    with pytest.raises(UserError, match=r"optimizer\.lr=.* is a range, but a sweep lists values") as raised:
        sweep_or_search(["optimizer.lr=uniform(0.1, 1)", f"paths.outputs={tmp_path}"], run_cells=pytest.fail)
    assert "add sweep.search=tpe" in raised.value.fix


@pytest.mark.slow
def test_a_study_of_another_space_under_the_same_name_is_refused(tmp_path):
    made_up_search(tmp_path / "one", trials=2)
    other = SPACE[:1]
    with pytest.raises(Killed):
        made_up_search(tmp_path / "two", trials=2, space=other, runs=MadeUpRuns(dies_after=0))
    there, here = (find_sweep("search", tmp_path / name) / "study.db" for name in ("one", "two"))
    here.write_bytes(there.read_bytes())
    with pytest.raises(UserError, match="another search under the name search: space") as raised:
        made_up_search(tmp_path / "two", trials=2, space=other, runs=pytest.fail)
    assert "optimizer.momentum: uniform(0.1, 0.99)" in raised.value.problem
    assert "sweep.name=<name>" in raised.value.fix


@pytest.mark.slow
def test_a_damaged_storage_is_named_with_what_to_do(tmp_path):
    made_up_search(tmp_path, trials=2)
    database = find_sweep("search", tmp_path) / "study.db"
    database.write_bytes(b"no database at all" * 1000)
    with pytest.raises(UserError, match=r"study\.db cannot be used") as raised:
        made_up_search(tmp_path, trials=2)
    assert "delete it" in raised.value.fix


def test_a_server_that_does_not_answer_is_named_without_its_password(tmp_path):
    address = "postgresql://me:secret@127.0.0.1:1/studies"
    with pytest.raises(UserError, match=r"sweep\.search\.storage=postgresql://me@127") as raised:
        made_up_search(tmp_path, f"sweep.search.storage='{address}'")
    assert "secret" not in str(raised.value)


def test_a_metric_that_runs_do_not_have_is_named_with_those_they_have(tmp_path):
    more = ("sweep.search.metric=val/gone", "sweep.search.direction=minimize")
    with pytest.raises(UserError, match="val/gone") as raised:
        made_up_search(tmp_path, *more)
    assert "val/accuracy, val/loss" in raised.value.fix


def test_the_report_tells_trials_winner_and_how_optimistic_the_search_was(whole):
    _, outputs, _ = whole
    found, folder = found_in(outputs), find_sweep("search", outputs)
    files = {path.name for path in report(folder, outputs, track=False)}
    assert {"report.md", "trials.csv", "winner.csv", "importances.csv", "history.png", "importances.png"} <= files
    text = (folder / "report" / "report.md").read_text()
    assert f"They took {found.runs} runs; all seeds for each would have been 36." in text
    chosen = found.winner.mean - np.mean([value for value, _ in found.fresh])
    assert f"better by {chosen:+.5f} than at fresh ones" in text
    assert "better by +0.01000 [+0.01000, +0.01000] on the validation split than on the test split" in text
    assert (folder / "report" / "trials.csv").read_text().count("\n") == 13
    assert read_plan(folder).is_search
    assert contrasts(sweep_results("search", outputs)) == []  # these would compare trials by their tests
    assert math.isclose(sum(read_json(folder / "search.json")["importances"].values()), 1)


@pytest.mark.slow
def test_a_search_has_one_life_in_the_store_and_its_page_says_what_leads(tmp_path, monkeypatch):
    from mlflow import MlflowClient

    from sextant.tracking.store import open_store

    store, seen, ends = open_store("sqlite", None, tmp_path), [], []
    terminate = MlflowClient.set_terminated
    monkeypatch.setattr(MlflowClient, "set_terminated", lambda *a, **k: (ends.append(k), terminate(*a, **k)))

    def parent():
        (found,) = store.client.search_runs([store.experiment_id("classification")])
        return found

    class Watched(MadeUpRuns):
        def __call__(self, cells):
            seen.append(parent())
            return super().__call__(cells)

    given = [word for word in arguments(tmp_path, trials=5) if word != "tracking=none"]
    sweep_or_search(given, run_cells=Watched())
    assert len(seen) > 5
    assert {found.info.status for found in seen} == {"RUNNING"}
    assert len(ends) == 1
    assert re.search(r"[1-4] of 5 trials so far; \d runs have ended", seen[3].data.tags["mlflow.note.content"])
    assert "Best: trial" in seen[3].data.tags["mlflow.note.content"]
    found, winner = parent(), found_in(tmp_path).winner
    assert found.info.status == "FINISHED"
    text = found.data.tags["mlflow.note.content"]
    assert f"Best: trial {winner.number}, `optimizer.lr={winner.setting['optimizer.lr']} " in text
    assert "5 of 5 trials" in text
    assert "page%2Fhistory.png" in text
    assert "page%2Fimportances.png" in text
    assert found.data.metrics["best/val accuracy"] == pytest.approx(winner.mean)
    sweep_or_search(given, run_cells=pytest.fail)  # nothing is missing, and nothing begins anew
    assert len(ends) == 1


def test_a_search_is_within_its_folder_whatever_that_is_called(tmp_path):
    outputs = tmp_path / "feature%2Flidar, q?x" / "c#1 [$HOME]"
    outcome = made_up_search(outputs, trials=2)
    assert outcome.directory.parent == outputs / "sweeps"
    assert (outcome.directory / "study.db").is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["feature%2Flidar, q?x"]
    assert [path.name for path in outputs.parent.iterdir()] == ["c#1 [$HOME]"]
