"""Launchers without a cluster: what is refused, what would be submitted, and what becomes of tasks that vanish."""

import os
import re
import signal
import threading
from functools import partial
from pathlib import Path

import pytest
from made_up_search import MadeUpRuns, arguments, made_up_search
from support import Hears, quick_config

from sextant import cli
from sextant.atomic_files import write_json
from sextant.cli.sweep import run_sweep as run_and_tell
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import own_configs
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.lease import take
from sextant.lifecycle import launchers
from sextant.lifecycle.launchers import CellTask, launch, processes, require_launcher
from sextant.lifecycle.launchers.slurm_queue import cancel_all, read_queue, submissions
from sextant.lifecycle.run_reporter import SILENT_RUN
from sextant.lifecycle.search.run import sweep_or_search
from sextant.lifecycle.sweep import dry_run, run_sweep
from sextant.lifecycle.sweep_plan import sweep_words
from sextant.lifecycle.sweep_status import cancel_sweep, sweep_status
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import run_lock
from sextant.runs.sweep_directory import attach_command, find_sweep, read_plan

SLURM = ("launcher=slurm", "launcher.lease_s=0.3", "tracking=none")


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Commands of a SLURM that accepts everything and has nothing in its queue, unless a file says so."""
    folder = tmp_path / "bin"
    folder.mkdir()
    commands = {
        "sbatch": f"echo x >> {folder}/submitted; echo Submitted batch job 7",
        "squeue": f"cat {folder}/queue 2>/dev/null || true",
        "scancel": f"echo $@ >> {folder}/cancelled",
        "sinfo": "echo 'main*'; echo gpu",
        "srun": "exit 1",
    }
    for name, line in commands.items():
        (folder / name).write_text(f"#!/bin/sh\n{line}\n")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.setattr("sextant.lifecycle.launchers.slurm.POLL_S", 0.02)
    return folder


def config(tmp_path, *overrides):
    return validate(quick_config(tmp_path, *overrides))


def cells(tmp_path, count):
    runs = [tmp_path / "runs" / "classification" / f"{number:08d}-s0" for number in range(count)]
    return [CellTask(("tracking=none",), run) for run in runs]


def finish(run):
    run.mkdir(parents=True)
    write_json(RunDirectory(run).metrics, {"outcome": "finished", "metrics": {}})


def test_a_launcher_is_no_part_of_an_experiment():
    assert len({digest(to_plain(compose([f"launcher={name}"]))) for name in ("local", "joblib", "slurm", "ray")}) == 1


@pytest.mark.parametrize(("launcher", "package"), [("slurm", "submitit"), ("ray", "ray")])
def test_a_launcher_without_its_package_is_told(tmp_path, monkeypatch, launcher, package):
    monkeypatch.setattr(
        launchers, "find_spec", lambda name: None if name == package else importlib.util.find_spec(name)
    )
    with pytest.raises(UserError, match=rf"needs {package}, .*\npip install 'sextant-vision\[{launcher}\]'"):
        require_launcher(config(tmp_path, f"launcher={launcher}", "tracking=none"))


def test_missing_commands_of_slurm_are_one_error(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="this machine has no sbatch, squeue, scancel, sinfo, srun\n"):
        run_sweep(["seed=0,1", *SLURM, f"paths.outputs={tmp_path}"])
    assert not (tmp_path / "sweeps").exists()


def test_a_partition_that_does_not_exist_is_told(tmp_path, slurm):
    require_launcher(config(tmp_path, *SLURM, "launcher.partition=gpu"))
    with pytest.raises(UserError, match=r"launcher.partition=gup: no such partition\nPartitions: main, gpu"):
        require_launcher(config(tmp_path, *SLURM, "launcher.partition=gup"))


def test_hydras_launchers_and_single_runs_on_a_cluster_are_refused(capsys):
    for words, told in (
        (["-m", "seed=0,1", "hydra/launcher=joblib"], "launcher=joblib launcher.workers=4"),
        (["launcher=slurm"], "sextant train -m launcher=slurm"),
        (["-m", "--cfg", "job", "seed=0,1"], "prints something about one run; -m starts many"),
    ):
        with pytest.raises(SystemExit):
            cli.run("train", words)
        assert told in capsys.readouterr().err


def test_a_dry_run_prints_what_sbatch_would_get_and_writes_nothing(tmp_path, slurm, capsys):
    resources = ["launcher.partition=gpu", "launcher.gpus=1", "launcher.time_min=90", "launcher.memory_gb=1.5"]
    more = ["launcher.cells_per_task=2", "launcher.at_once=2", "+launcher.options.constraint=a100"]
    outputs = tmp_path / "outputs"
    cli.run("train", ["-m", "--dry-run", "seed=0,1,2,3,4", f"paths.outputs={outputs}", *SLURM, *resources, *more])
    text = capsys.readouterr().out
    assert "5 runs are missing" in text
    assert len(re.findall(r"^classification/\w{8}-s\d  ", text, re.MULTILINE)) == 5
    for line in (
        "array=0-2%2",
        "partition=gpu",
        "gpus-per-node=1",
        "time=90",
        "mem=1536MB",
        "constraint=a100",
        "requeue",
    ):
        assert f"#SBATCH --{line}" in text
    assert list(outputs.iterdir()) == []
    assert not (slurm / "submitted").exists()
    assert dry_run(["seed=0,1", "launcher=local", f"paths.outputs={outputs}"])[1] == ""


def test_a_process_that_is_killed_ends_its_own_run_alone(tmp_path, monkeypatch):
    def work(words, runs):
        import os
        import signal
        from pathlib import Path

        name = words[0]
        with Path(tmp_path, name).open("a") as file:
            file.write("x")
        if name == "twice" or (name == "once" and Path(tmp_path, name).read_text() == "x"):
            os.kill(os.getpid(), signal.SIGKILL)
        return {"status": "finished", "message": name}

    monkeypatch.setattr(processes, "_in_worker", work)
    names = ["a", "twice", "once", "b"]
    outcomes = processes.run_in_processes([CellTask((name,), tmp_path / name) for name in names], 2, SILENT_RUN)
    assert [outcome["status"] for outcome in outcomes] == ["finished", "failed", "finished", "finished"]
    assert [outcome["message"] for outcome in (outcomes[0], *outcomes[2:])] == ["a", "once", "b"]
    assert re.match(r"its process died 2 times \(SIGKILL", outcomes[1]["message"])
    assert [Path(tmp_path, name).read_text() for name in names] == ["x", "xx", "xx", "x"]


@pytest.mark.slow
def test_the_run_of_a_worker_may_load_its_data_in_processes(tmp_path, monkeypatch):
    def work(words, runs):
        import torch

        from sextant.data.batches import EpochBatches, loader

        processes._settle()
        batches = loader(torch.arange(4), EpochBatches(4, 2), workers=1)
        return {"status": "finished", "message": str([batch.tolist() for batch in batches])}

    monkeypatch.setattr(processes, "_in_worker", work)
    (outcome,) = processes.run_in_processes([CellTask(("a",), tmp_path)], 1, SILENT_RUN)
    assert outcome["message"] == "[[0, 1], [2, 3]]"


def test_tasks_that_vanish_are_submitted_again_and_then_given_up(tmp_path, slurm):
    (good, bad), folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    finish(good.run)
    outcomes = launch([good, bad], config(tmp_path, *SLURM, "launcher.attempts=2"), folder)
    assert [outcome["status"] for outcome in outcomes] == ["finished", "failed"]
    assert (
        f"its task ended 2 times without recording an outcome; no log was written: do all nodes share {folder}?"
        in outcomes[1]["message"]
    )
    assert [submission.tasks for submission in submissions(folder)] == [[[good.name], [bad.name]], [[bad.name]]]


def test_what_waits_in_the_queue_is_not_submitted_again_and_what_is_cancelled_ends(tmp_path, slurm):
    both, folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    assert launch(both, config(tmp_path, *SLURM, "launcher.wait=false"), folder) == [None, None]
    (submission,) = submissions(folder)
    (slurm / "queue").write_text(
        f"{submission.name}|1|7|PENDING|0|(Resources)\n{submission.name}|0|7|COMPLETING|0|n1\n"
    )
    assert read_queue()[submission.name, 1].job == "7_1"
    assert launch(both, config(tmp_path, *SLURM, "launcher.wait=false"), folder) == [None, None]
    assert [submission.tasks for submission in submissions(folder)] == [[[c.name] for c in both], [[both[0].name]]]
    assert cancel_all(folder) == 1
    assert (slurm / "cancelled").read_text() == "7_1\n"


def test_whoever_waits_for_tasks_and_is_interrupted_says_what_became_of_them(tmp_path, slurm, monkeypatch):
    (cell,), folder, listening = cells(tmp_path, 1), tmp_path / "sweeps" / "one", Hears()

    def interrupted(*_):
        if listening.said:
            cancel_all(folder)
        raise KeyboardInterrupt

    monkeypatch.setattr("sextant.lifecycle.launchers.slurm._Arrays.wait", interrupted)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            launch([cell], config(tmp_path, *SLURM), folder, listening)
    assert listening.said == [
        f"the jobs go on; {attach_command(folder)} waits for them, {attach_command(folder, 'cancel')} ends them",
        f"the jobs were cancelled; {attach_command(folder)}",
    ]


def test_cancelling_a_sweep_of_slurm_that_is_run_here_by_now_ends_its_process(tmp_path, slurm, monkeypatch):
    directory = run_sweep(["seed=0,1", *SLURM, "launcher.wait=false", f"paths.outputs={tmp_path}"]).directory
    killed = []
    monkeypatch.setattr(os, "kill", lambda *how: killed.append(how))
    with run_lock(directory.parent, directory.name, wait=False):
        assert re.match(r"0 tasks cancelled; process \d+ on .* was interrupted; ", cancel_sweep(directory))
        assert killed == [(os.getpid(), signal.SIGINT)]
        with monkeypatch.context() as patch:
            patch.setattr("sextant.lease._place", lambda: "another host")
            assert re.match("0 tasks cancelled; .*, another host: if it does not", cancel_sweep(directory))
        assert len(killed) == 1
        monkeypatch.setenv("PATH", str(tmp_path))
        with pytest.raises(UserError, match=r"process .* was interrupted; nothing was cancelled in SLURM's queue: sq"):
            cancel_sweep(directory)
        assert len(killed) == 2


@pytest.mark.slow
def test_a_search_that_is_cancelled_submits_nothing_more_and_the_same_command_goes_on(tmp_path, slurm):
    marked = "find . -name tasks.json -exec sed -i s/false/true/ {} +"  # as sextant sweep cancel does
    (slurm / "sbatch").write_text(f"#!/bin/sh\ncd {tmp_path}/cancelled\n{marked}\necho Submitted batch job 7\n")
    words = arguments(tmp_path / "cancelled", *SLURM, trials=3)
    with pytest.raises(
        UserError, match=r"^search-\w+ was cancelled\n.* sextant sweep attach search-\w+ outputs=.*, continues it"
    ):
        sweep_or_search(words)
    assert len(submissions(find_sweep("search", tmp_path / "cancelled"))) == 1
    found = sweep_or_search(words, run_cells=MadeUpRuns())
    whole = made_up_search(tmp_path / "whole", trials=3)
    assert [(cell.run, cell.message) for cell in found.cells] == [(cell.run, "") for cell in whole.cells]


@pytest.mark.parametrize("wait", [True, False])
def test_a_search_that_is_not_to_wait_says_that_it_does(tmp_path, slurm, wait):
    listening = Hears()
    words = arguments(tmp_path, *SLURM, f"launcher.wait={wait}", trials=1)
    sweep_or_search(words, listening, run_cells=MadeUpRuns())
    said = "launcher.wait=false: a search waits nevertheless"
    assert any(remark.startswith(said) for remark in listening.said) != wait


NO_SQUEUE, NO_CONTROLLER = "squeue: No such file or directory", "squeue: no controller answers"


@pytest.mark.parametrize("reason", [NO_SQUEUE, NO_CONTROLLER])
def test_without_the_queue_run_directories_tell_the_status_and_nothing_is_cancelled(
    tmp_path, slurm, monkeypatch, capsys, reason
):
    given = ["seed=0,1", *SLURM, "launcher.wait=false", f"paths.outputs={tmp_path}"]
    directory = run_sweep(given).directory
    finish(tmp_path / read_plan(directory).cells[0].run)
    if reason == NO_SQUEUE:
        monkeypatch.setenv("PATH", str(tmp_path))
    else:
        (slurm / "squeue").write_text("#!/bin/sh\necho no controller answers >&2; exit 1\n")
    cli.run("sweep", ["status", "sweep", f"outputs={tmp_path}"])
    said = capsys.readouterr().out
    assert f"{reason}; runs that wait in SLURM's queue are not shown" in said
    assert "1 finished, 1 missing" in said
    with pytest.raises(SystemExit):
        cli.run("sweep", ["cancel", "sweep", f"outputs={tmp_path}"])
    assert reason in capsys.readouterr().err
    assert not any(submission.cancelled for submission in submissions(directory))


@pytest.fixture
def dead_elsewhere(monkeypatch):
    """Leave the lease of a process of another host, which has died with it."""

    def leave(folder):
        with monkeypatch.context() as patch:
            patch.setattr("sextant.lease._place", lambda: "another host")
            lease = take(folder, 0.01)
            lease._released.set()
            lease._thread.join()

    return leave


@pytest.fixture
def waiting(tmp_path, slurm):
    """Start to wait for cells in a thread; returns it, and the submission once there is one."""
    threads = []

    def start(cells, folder, *overrides):
        given = config(tmp_path, *SLURM, *overrides)
        thread = threading.Thread(target=launch, args=(cells, given, folder), daemon=True)
        thread.start()
        while not (slurm / "submitted").exists():
            thread.join(0.01)
        threads.append((cells, thread))
        return thread, submissions(folder)[-1]

    yield start
    for cells_left, thread in threads:
        for cell in cells_left:
            if not RunDirectory(cell.run).metrics.exists():
                finish(cell.run)
        thread.join(30)
        assert not thread.is_alive()


def test_the_task_of_a_node_that_is_silent_is_cancelled_and_submitted_elsewhere(
    tmp_path, slurm, dead_elsewhere, waiting
):
    (cell,), folder = cells(tmp_path, 1), tmp_path / "sweeps" / "one"
    thread, submission = waiting([cell], folder, "launcher.attempts=3")
    dead_elsewhere(submission.alive(0) / "1")
    (slurm / "queue").write_text(f"{submission.name}|N/A|7|RUNNING|1|n1\n")
    while len(submissions(folder)) < 2:
        thread.join(0.01)
        assert thread.is_alive()
    assert "7" in (slurm / "cancelled").read_text().split()


@pytest.mark.slow
def test_a_task_that_starts_anew_or_is_at_another_run_is_not_taken_for_silent(tmp_path, slurm, dead_elsewhere, waiting):
    (started, behind), folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    for cell in (started, behind):  # begun before, by processes that died
        dead_elsewhere(cell.run.parent / ".locks" / cell.run.name)
    thread, submission = waiting([started, behind], folder, "launcher.cells_per_task=2")
    dead_elsewhere(submission.alive(0) / "0")  # its first start died; the second has yet to give a sign of life
    asked = slurm / "asked"
    (slurm / "squeue").write_text(f"#!/bin/sh\necho x >> {asked}\ncat {slurm}/queue\n")
    (slurm / "queue").write_text(f"{submission.name}|N/A|7|RUNNING|1|n1\n")
    lease, before = None, 0
    for _ in range(2):
        while not asked.exists() or asked.read_text().count("x") < before + 6:  # more than lease_s apart
            thread.join(0.01)
            assert thread.is_alive()
        before = asked.read_text().count("x")
        lease = lease or take(submission.alive(0) / "1", 60)
    lease.release()
    assert not (slurm / "cancelled").exists()
    assert len(submissions(folder)) == 1


def test_a_failed_run_whose_task_is_at_another_is_submitted_again_when_asked(tmp_path, slurm):
    (bad, slow), folder = cells(tmp_path, 2), tmp_path / "sweeps" / "one"
    leave = config(tmp_path, *SLURM, "launcher.wait=false", "launcher.cells_per_task=2")
    launch([bad, slow], leave, folder)
    (submission,) = submissions(folder)
    (slurm / "queue").write_text(f"{submission.name}|N/A|7|RUNNING|0|n1\n")
    write_json(folder / "outcomes" / f"{bad.run.parent.name}-{bad.run.name}.json", {"status": "failed", "message": "x"})
    launch([bad, slow], leave, folder)
    assert [submission.tasks for submission in submissions(folder)] == [[[bad.name, slow.name]], [[bad.name]]]
    launch([bad, slow], leave, folder)  # that waits in the queue now
    (slurm / "queue").write_text("".join(f"{each.name}|N/A|7|RUNNING|0|n1\n" for each in submissions(folder)))
    launch([bad, slow], leave, folder)
    assert len(submissions(folder)) == 3


def test_attaching_knows_the_folder_of_ones_own_config_files(tmp_path, monkeypatch):
    (tmp_path / "own" / "trainer").mkdir(parents=True)
    (tmp_path / "own" / "trainer" / "mine.yaml").write_text("defaults: [fast, _self_]\nmax_epochs: 1\n")
    outputs = tmp_path / "outputs"
    given = ["trainer=mine", "seed=0,1", "tracking=none", f"paths.outputs={outputs}"]

    planned = []

    def launch_none(cells, *_):
        planned.append({cell.run for cell in cells})
        return [None] * len(cells)

    monkeypatch.setattr("sextant.lifecycle.sweep.launch", launch_none)
    with own_configs(tmp_path / "own"):
        run_sweep(given)
    command = read_plan(find_sweep("sweep", outputs)).command
    cli.run("sweep", ["attach", "sweep", f"outputs={outputs}"])
    assert planned[0] == planned[1]
    assert len(planned[0]) == 2
    assert read_plan(find_sweep("sweep", outputs)).command == command
    outputs.rename(moved := tmp_path / "moved, all")
    cli.run("sweep", ["attach", "sweep", f"outputs={moved}"])
    assert planned[2] == {moved / run.relative_to(outputs) for run in planned[0]}
    assert not outputs.exists()


def test_a_run_that_finished_where_its_results_are_not_seen_from_here_says_so(tmp_path, capsys):
    def elsewhere(jobs):
        finish(jobs[0].run)
        return [{"status": "finished", "message": ""}] * 2

    with pytest.raises(SystemExit):
        run_and_tell(["seed=0,1", "tracking=none", f"paths.outputs={tmp_path}"], run_cells=elsewhere)
    said = " ".join(capsys.readouterr().out.split())
    assert "2 planned, 1 finished, 0 diverged, 1 failed" in said
    assert "seed 1: it finished, but its results are not here: do all hosts share" in said
    assert [(state.state, state.where[:11]) for state in sweep_status(find_sweep("sweep", tmp_path))[0]] == [
        ("finished", ""),
        ("failed", "it finished"),
    ]


def test_a_block_keeps_what_another_said_of_its_runs(tmp_path):
    given = ["sweep=demo", "sweep.seeds=2", "tracking=none", f"paths.outputs={tmp_path}"]

    def run_cells(jobs, how):
        for job in jobs if how == "finished" else ():
            finish(job.run)
        return [{"status": how, "message": "its process died"}] * len(jobs)

    for block, how in (("1/2", "failed"), ("2/2", "finished")):
        run_sweep(sweep_words([*given, f"sweep.block={block}"]), run_cells=partial(run_cells, how=how))
    states = [state.state for state in sweep_status(find_sweep("demo", tmp_path))[0]]
    assert sorted(states) == ["failed"] * 6 + ["finished"] * 6
    run_sweep(sweep_words([*given, "sweep.block=1/2"]), run_cells=partial(run_cells, how="finished"))
    assert [cell.message for cell in read_plan(find_sweep("demo", tmp_path)).cells] == [""] * 12


def test_the_status_of_a_sweep_says_what_each_run_is_at(tmp_path):
    given = ["seed=0,1,2,3", "tracking=none", f"paths.outputs={tmp_path}"]

    def run_cells(jobs):
        finish(jobs[0].run)
        jobs[1].run.mkdir(parents=True)
        RunDirectory(jobs[1].run).update_state({"failure": "UserError: broken"})
        lease = take(jobs[2].run.parent / ".locks" / jobs[2].run.name)
        states, controller = sweep_status(find_sweep("sweep", tmp_path))
        assert [state.state for state in states] == ["finished", "failed", "running", "missing"]
        assert states[1].where == "UserError: broken"
        assert states[2].where.startswith("process ")
        assert controller.here
        lease.release()
        return [{"status": "finished", "message": ""}, None, None, None]

    run_sweep(given, run_cells=run_cells)
    states, controller = sweep_status(find_sweep("sweep", tmp_path))
    assert [state.state for state in states] == ["finished", "failed", "missing", "missing"]
    assert controller is None
