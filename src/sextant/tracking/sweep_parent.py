"""The MLflow run of a sweep, the parent of the runs of its cells."""

import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from urllib.parse import urlencode

from sextant.atomic_files import read_json
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import RunDirectory
from sextant.runs.locks import LockedError, run_lock
from sextant.runs.sweep_directory import Cell, SweepPlan, read_plan, read_plans
from sextant.tracking.mirror import (
    NOTE,
    PARENT,
    MirroredRun,
    Status,
    clean_params,
    described,
    ended_at,
    known_run,
    milliseconds,
)
from sextant.tracking.store import Kind, Store, open_store, require_server, telling_store_errors

#: file in the directory of a sweep with the page that its parent run shows, and folder of the page's figures
PAGE, PICTURES = "page.json", "page"
#: placeholder in the page for the parent's id, which changes when a store is refilled
PARENT_ID = "PARENT"
#: metric of the page: number of runs that have ended
DONE = "runs/done"
#: tag of a parent with the version of its page; stores and pages of other versions are brought up to date
VERSION, PRESENT = "sextant.page", "2"
#: largest number of arms in the name of a sweep's run
MOST_ARMS = 4


def open_parent(kind: Kind, uri: str | None, outputs: Path, plan: SweepPlan, experiment: str) -> MirroredRun:
    """Open the store in the controller, before any worker does, and open the parent run of a sweep in it.

    A resumed sweep keeps its parent run.
    """
    with telling_store_errors(uri, outputs):
        store = open_store(kind, uri, outputs)
        mirror = _find_or_make(store, store.experiment_id(experiment), plan, outputs)
    mirror.status("RUNNING")
    return mirror


def _find_or_make(store: Store, experiment_id: str, plan: SweepPlan, outputs: Path) -> MirroredRun:
    known = known_run(store, plan.mlflow_runs)
    if known is not None:
        return MirroredRun(store, known)
    key, began = plan.directory(outputs).name, milliseconds(_began(plan, outputs))
    query = f"tags.`sextant.sweep` = '{key}' and attributes.start_time = {began}"
    found = store.client.search_runs([experiment_id], query, max_results=1)  # created, but killed before the record
    if found:
        return MirroredRun(store, found[0].info.run_id)
    name = parent_name(plan)
    tags = {"mlflow.runName": name, "sextant.sweep": key, "sextant.command": " ".join(plan.command)}
    if plan.definition.get("question"):
        tags[NOTE] = str(plan.definition["question"])
    made = store.client.create_run(experiment_id, start_time=began, tags=tags, run_name=name)
    return MirroredRun(store, made.info.run_id)


def artifact_address(path: str) -> str:
    """The address of an artifact of the parent on MLflow's server, relative to its pages; see :func:`send_page`."""
    return f"get-artifact?{urlencode({'path': path, 'run_uuid': PARENT_ID})}"


def send_page(parent: MirroredRun, directory: Path) -> None:
    """Send the page of a sweep and its pictures, if the sweep's directory has them."""
    page = read_json(directory / PAGE)
    if page is None:
        return
    text = str(page["text"]).replace(PARENT_ID, parent.run_id)
    parent.tags({NOTE: text, **page["tags"], **page.get("own_tags", {})})  # a page of before has none
    parent.params(page["params"])
    parent.log(page["metrics"], page["step"], milliseconds(time.time()))
    parent.flush()
    parent.artifacts(directory / PICTURES)


def label_cells(
    parent: MirroredRun,
    plan: SweepPlan,
    outputs: Path,
    tags: Mapping[str, str] = MappingProxyType({}),
    named: Container[str] = (),
) -> set[str]:
    """Name the runs of a sweep by arm, setting, seed and digest, and tag them; arms that evaluate one run share it.

    A run that no sweep made becomes part of this one; a run of another sweep keeps its name. Runs in ``named`` are
    skipped. Returns the runs that have a name now.
    """
    cells: dict[str, list[Cell]] = {}
    for cell in plan.cells:
        if cell.run not in named:
            cells.setdefault(cell.run, []).append(cell)
    found_now: set[str] = set()
    for run, of_run in cells.items():
        found = known_run(parent.store, RunDirectory(outputs / run).tracking_ids())
        if found is None:
            continue
        found_now.add(run)
        arms, first = [cell.arm for cell in of_run], of_run[0]
        name = run_name(arms, first.setting, first.seed, first.digest)
        _tie(parent, plan, RunDirectory(outputs / run))
        known = parent.store.client.get_run(found)
        if known.info.run_name != name and known.data.tags.get(PARENT, parent.run_id) == parent.run_id:
            about = f"{name}, of the sweep {plan.name}. {plan.definition.get('question') or ''}".rstrip()
            own = {"mlflow.runName": name, "arm": " + ".join(arms), "setting": first.setting, "sweep": plan.name}
            own[NOTE] = described(RunDirectory(outputs / run), about)
            child = MirroredRun(parent.store, found)
            child.tags({**own, **tags})
            child.params(clean_params(RunDirectory(outputs / run).state().get("params", {}), _varied(plan)))
    return found_now


def _varied(plan: SweepPlan) -> list[str]:
    """The keys in which the runs of a sweep differ: its factors, its search space, and the overrides of its arms."""
    arms = plan.definition.get("arms") or {}
    overrides = [override for arm in arms.values() for override in arm.get("overrides", [])]
    space = (plan.definition.get("search") or {}).get("space") or {}
    keys = [override.lstrip("+~").partition("=")[0] for override in overrides]
    return list(dict.fromkeys([*plan.cells[0].factors, *space, *keys]))


def run_name(arms: Sequence[str], setting: str, seed: int, digest: str) -> str:
    """The name of a run of a sweep.

    >>> run_name(["push_pull"], "lenet_a", 3, "94bbbd32f6507c70")
    'push_pull lenet_a seed 3 (94bbbd32)'
    """
    return " ".join([" + ".join(arms), *([] if setting == "-" else [setting]), f"seed {seed}", f"({digest[:8]})"])


def parent_name(plan: SweepPlan) -> str:
    """The name of the run of a sweep: its title, its digest and its first arms; a search has trials in place of arms.

    >>> cells = [Cell({}, arm, 0, 0, "94bbbd32", "runs/a/b") for arm in ("conv", "push_pull")]
    >>> parent_name(SweepPlan("demo", {"arms": {"conv": {}, "push_pull": {}}}, [], cells))
    'demo 75b6f062: conv, push_pull'
    """
    arms = [] if plan.is_search else list(plan.definition.get("arms") or {})
    listed = ", ".join([*arms[:MOST_ARMS], *(["..."] if len(arms) > MOST_ARMS else [])])
    title = f"{plan.title} {plan.digest[:8]}"
    return f"{title}: {listed}" if listed and listed not in plan.title else title


def log_report(outputs: Path, plan: SweepPlan, report: Path) -> None:
    """Copy a report to the parent run of its sweep, in the store to which the sweep was logged."""
    kind: Kind = "server" if plan.tracking.get("kind") == "server" else "sqlite"
    with telling_store_errors(plan.tracking.get("uri"), outputs):
        store = open_store(kind, plan.tracking.get("uri"), outputs)
        parent = known_run(store, plan.mlflow_runs)
    if parent is not None:
        MirroredRun(store, parent).artifacts(report)


def refill_parents(
    store: Store,
    outputs: Path,
    changed: Sequence[RunDirectory] = (),
    *,
    all_of_them: bool = True,
    reporter: Reporter = SILENT,
) -> int:
    """Create the parent runs that a store lacks, end those that no process runs, send pages, and attach cells.

    Args:
        store: the tracking store.
        outputs: output folder with the sweeps.
        changed: run directories whose MLflow runs may have been recreated.
        all_of_them: false considers only sweeps that log to this store and have had a parent in it.
        reporter: receives messages about unreadable sweeps.

    Returns:
        The number of parent runs that were created, ended or brought up to date.
    """
    repaired = 0
    for directory, found in sorted(read_plans(outputs, reporter).items(), key=_first_begun):
        if not (all_of_them or store.is_at(found.tracking.get("kind"), found.tracking.get("uri"))):
            continue
        try:
            with run_lock(outputs / "sweeps", directory.name, wait=False):
                plan = read_plan(directory)
                if all_of_them or (plan.mlflow_runs and not _deleted(store, plan)):
                    repaired += _repair(store, outputs, plan, changed)
        except LockedError:
            continue
    return repaired


def _first_begun(sweep: tuple[Path, SweepPlan]) -> tuple[float, str]:
    """Sort key of sweeps by their start; a run shared by several sweeps is a child of the first, which names it."""
    directory, plan = sweep
    return plan.began or plan.started, directory.name


def _repair(store: Store, outputs: Path, plan: SweepPlan, changed: Sequence[RunDirectory]) -> bool:
    """Repair the parent run of a sweep, and return whether it had to be created, ended or brought up to date.

    It is created if the store lacks it, also if the sweep was run with ``tracking=none``. It is ended if it is RUNNING
    although no process runs its sweep. It is brought up to date if it does not count all runs that have ended.
    """
    runs, directory = [RunDirectory(outputs / cell.run) for cell in plan.cells], plan.directory(outputs)
    if not plan.mlflow_runs and not any(run.state() for run in runs):
        return False
    known = known_run(store, plan.mlflow_runs)
    if known is None:
        experiment = next((run.state()["experiment"] for run in runs if "experiment" in run.state()), "sweeps")
        parent = _find_or_make(store, store.experiment_id(str(experiment)), plan, outputs)
        plan = replace(plan, mlflow_runs=[*plan.mlflow_runs, parent.run_id])
        if plan.tracking.get("kind") in (None, "none"):  # its reports go there from now on
            here = store.artifacts is not None
            plan = replace(plan, tracking={"kind": "sqlite" if here else "server", "uri": None if here else store.uri})
        plan.write(outputs)
        parent.artifacts(directory / "report")
    else:
        parent = MirroredRun(store, known)
    for run in runs if known is None else [run for run in runs if run in changed]:
        _tie(parent, plan, run)
    behind = known is None or _rename(parent, plan) or _behind(store, known, directory)
    if behind or any(run in changed for run in runs):
        label_cells(parent, plan, outputs, (read_json(directory / PAGE) or {}).get("tags", {}))
    if behind:
        send_page(parent, directory)
        parent.status(ended_status(plan, outputs), plan.ended or max(map(ended_at, runs)))
    if parent.broken and store.artifacts is None:
        require_server(store.uri)
    return behind


def _rename(parent: MirroredRun, plan: SweepPlan) -> bool:
    """Give a parent that has the name of an earlier version its present one; return whether it did."""
    is_former = bool(parent.store.client.get_run(parent.run_id).info.run_name == plan.title)
    if is_former:
        parent.tags({"mlflow.runName": parent_name(plan)})
    return is_former


def _tie(parent: MirroredRun, plan: SweepPlan, run: RunDirectory) -> None:
    """Make a run a child of the parent, unless it belongs to the parent of another sweep."""
    begun_by = (run.state().get("tracking") or {}).get("parent_run")
    child = known_run(parent.store, run.tracking_ids())
    if child is None or begun_by not in (None, *plan.mlflow_runs):
        return
    tied_to = parent.store.client.get_run(child).data.tags.get(PARENT)
    if begun_by is not None or tied_to is None or known_run(parent.store, [tied_to]) is None:
        MirroredRun(parent.store, child).tags({PARENT: parent.run_id})


def _behind(store: Store, parent: str, directory: Path) -> bool:
    """Whether the parent has not ended, or the page in the sweep's directory has another count of runs or version."""
    found, page = store.client.get_run(parent), read_json(directory / PAGE)
    is_running = bool(found.info.status == "RUNNING")
    if page is None or is_running:
        return is_running
    version = page.get("own_tags", {}).get(VERSION)
    return bool(found.data.metrics.get(DONE) != page["metrics"].get(DONE) or found.data.tags.get(VERSION) != version)


def _deleted(store: Store, plan: SweepPlan) -> bool:
    """Whether a user deleted the parent in the store, which can restore it."""
    return known_run(store, plan.mlflow_runs) is None and known_run(store, plan.mlflow_runs, deleted=True) is not None


def _began(plan: SweepPlan, outputs: Path) -> float:
    """When a sweep began; for old plans without this record, when its first run began."""
    states = [RunDirectory(outputs / cell.run).state() for cell in plan.cells]
    return plan.began or min((state["started"] for state in states if "started" in state), default=plan.started)


def ended_status(plan: SweepPlan, outputs: Path) -> Status:
    """The status of a sweep that no process runs; one whose runs all diverged has FAILED, as it compares nothing."""
    results = [RunDirectory(outputs / cell.run).results() for cell in plan.cells]
    if all(found is not None for found in results):
        diverged = all(found is not None and found["outcome"] == "diverged" for found in results)
        return "FAILED" if diverged else "FINISHED"
    return "FAILED" if any(cell.message for cell in plan.cells) else "KILLED"
