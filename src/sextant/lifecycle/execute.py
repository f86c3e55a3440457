"""The life cycle of one run: claim its directory, train, test, write the results, mirror them."""

import math
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import yaml

from sextant.atomic_files import write_atomically, write_json
from sextant.config import Config, digest
from sextant.config.building import naming_groups
from sextant.errors import LossNotFiniteError, UserError
from sextant.kit.chapter import Source
from sextant.lease import Lease
from sextant.lifecycle.checks import checked, require_possible
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.registry import chapter_of
from sextant.runs.directory import Claim, RunDirectory, RunKey, claim
from sextant.runs.locks import run_lock
from sextant.runs.source_tree import source_sha256

if TYPE_CHECKING:
    from sextant.tracking.mirror import MirroredRun

OpenMirror = Callable[[], "MirroredRun | None"]
Work = Callable[[RunDirectory, OpenMirror], dict[str, Any]]
NO_PARAMETERS = ("paths", "tracking", "sweep", "launcher")
Status = Literal["finished", "diverged", "failed", "submitted"]


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes:
        status: ``diverged`` is a run that finished without having learnt, by the rule of ``evaluation.protocols``, or
            whose loss became nan; ``failed`` is a run ended by an error; ``submitted`` is a run that a cluster has yet
            to compute.
        directory: the run directory.
        reused: whether the run had been finished before.
        message: why the run failed.
    """

    status: Status
    directory: Path
    reused: bool = False
    message: str = ""

    @property
    def metrics(self) -> dict[str, float]:
        """Final metrics by name, nan for one that is not a number; empty if the run failed or was stopped by a nan."""
        found = (RunDirectory(self.directory).results() or {}).get("metrics", {})
        return {name: math.nan if value is None else value for name, value in found.items()}


def run_key(config: Config, source: Source) -> RunKey:
    """The identity of the run that a config describes."""
    code = source_sha256(config.custom_targets())
    return RunKey(config.task.name, run_digest(config), config.seed, code, source.fingerprint())


def run_digest(config: Config) -> str:
    """The digest of a typed config, in which 2 and 2.0 are the same number."""
    return digest(chapter_of(config.task.name).identity(config))


def execute(raw: Mapping[str, Any], *, wait: bool = False, reporter: RunReporter = SILENT_RUN) -> Outcome:
    """Execute the run that a plain, resolved config describes, unless it is already finished.

    Args:
        raw: the config.
        wait: whether to wait for another process that computes the same run instead of giving up.
        reporter: listens to the run.

    Raises:
        UserError: the config or the data are wrong; the run directory keeps earlier progress.
        KeyboardInterrupt: the run was interrupted and can be resumed.
    """
    config = checked(raw)
    with naming_groups(config.plain):
        source = chapter_of(config.task.name, reporter).source(config)
        key = run_key(config, source)

    def work(directory: RunDirectory, open_mirror: OpenMirror) -> dict[str, Any]:
        from sextant.lifecycle.training import train_and_test

        return train_and_test(config, source, directory, key, open_mirror(), reporter)

    possible = partial(require_possible, config, source)
    with naming_groups(config.plain):
        return run_once(key, config, work, possible, wait=wait, reporter=reporter)


def run_once(
    key: RunKey,
    config: Config,
    work: Work,
    check: Callable[[], None],
    *,
    wait: bool = False,
    published: Mapping[str, Any] | None = None,
    reporter: RunReporter = SILENT_RUN,
) -> Outcome:
    """Return the finished run ``key`` if there is one; otherwise do its ``work`` in its directory, under its lock.

    ``work`` receives the directory and a function that opens the MLflow run, and returns the content of its
    ``metrics.json``. ``published`` is what the file of a network trained elsewhere states about its training. ``check``
    raises an error if the work is impossible, before a directory is created.
    """
    outputs = Path(config.paths.outputs)
    with run_lock(outputs / "runs" / key.task, key.name, wait, config.launcher.lease_s) as lease:
        found = claim(outputs, key, config.reuse)
        results = found.directory.results()
        if not found.finished or results is None:
            check()
            return _Run(found, key, config, reporter, lease).run(work, published)
    if config.tracking.parent_run is None:
        fill_if_behind(config, [found.directory], reporter)
    return Outcome(results["outcome"], found.directory.path, reused=True, message=str(results.get("message", "")))


def fill_if_behind(config: Config, directories: Iterable[RunDirectory], reporter: RunReporter = SILENT_RUN) -> None:
    """Fill the tracking store if it lacks any of these runs; this process must not hold the lock of any of them."""
    notes = [directory.state().get("tracking") or {} for directory in directories]
    if config.tracking.kind != "none" and not all(note.get("sent", True) for note in notes):
        from sextant.tracking.refill import catch_up

        catch_up(config.tracking.kind, config.tracking.uri, Path(config.paths.outputs), reporter)


class _Run:
    """One run, from claiming its directory to its outcome."""

    def __init__(self, found: Claim, key: RunKey, config: Config, reporter: RunReporter, lease: Lease):
        self.directory: RunDirectory = found.directory
        self.lease = lease
        self.passed_over = found.passed_over
        self.key, self.config, self.reporter = key, config, reporter
        self.mirror: MirroredRun | None = None

    def run(self, work: Work, published: Mapping[str, Any] | None = None) -> Outcome:
        self._begin()
        self.reporter.begin(self.config, self.directory, self.passed_over, published)
        with self._recorded():
            results = work(self.directory, self._open_mirror)
        return Outcome(results["outcome"], self.directory.path)

    @property
    def _experiment(self) -> str:
        return self.config.tracking.experiment or self.config.task.name

    def _begin(self) -> None:
        path = self.directory.path
        path.mkdir(parents=True, exist_ok=True)
        # files that a process left when it was killed while writing, and how an earlier attempt ended
        for leftover in (*path.rglob(".*.tmp"), self.directory.traceback):
            leftover.unlink(missing_ok=True)
        plain = dict(self.config.plain)
        params = {key: value for key, value in plain.items() if key not in NO_PARAMETERS}
        text = yaml.safe_dump(plain, sort_keys=False)
        write_atomically(self.directory.config, lambda file: file.write(text.encode()))
        earlier = self.directory.state()
        self.directory.update_state(
            {
                **asdict(self.key),
                "experiment": self._experiment,
                "started": earlier.get("started", time.time()),
                "ended": None,
                "failure": None,
                "tracking": self._tracking_note(earlier.get("tracking")),
                "params": _flat(params),
            }
        )

    def _tracking_note(self, earlier: Mapping[str, Any] | None) -> dict[str, Any] | None:
        """Where this run is mirrored, or was when it began; a later refill of the store reads this note."""
        tracking = self.config.tracking
        if tracking.kind == "none":
            return {**earlier, "sent": False} if earlier else None
        names = ("kind", "uri", "parent_run", "log_checkpoint")
        return {name: getattr(tracking, name) for name in names} | {"sent": False}

    def _open_mirror(self) -> "MirroredRun | None":
        from sextant.runs.provenance import provenance

        self.directory.update_state({"provenance": provenance()})
        tracking = self.config.tracking
        if tracking.kind == "none":
            return None
        from sextant.tracking.mirror import open_mirror
        from sextant.tracking.refill import catch_up
        from sextant.tracking.store import open_store, telling_store_errors

        outputs = Path(self.config.paths.outputs)
        try:
            with telling_store_errors(tracking.uri, outputs):
                store = open_store(tracking.kind, tracking.uri, outputs)
                self.mirror = open_mirror(
                    store,
                    self.directory,
                    experiment=self._experiment,
                    parent=tracking.parent_run,
                    reporter=self.reporter,
                )
        except UserError as error:
            if tracking.parent_run is None:
                raise
            self.reporter.say(f"{error.problem}; this run of the sweep continues without tracking")
            return None
        if tracking.parent_run is None:  # for a sweep, its controller has done this
            catch_up(tracking.kind, tracking.uri, outputs, self.reporter)
        return self.mirror

    @contextmanager
    def _recorded(self) -> Iterator[None]:
        """Record how the run ended in its directory and its mirror, whatever ends it."""
        try:
            yield
        except BaseException as error:
            if self.lease.taken_over():  # the directory now belongs to another process
                raise
            interrupted = isinstance(error, KeyboardInterrupt | SystemExit)
            message = "interrupted" if interrupted else f"{type(error).__name__}: {error}"
            with suppress(OSError):  # a full disk must not hide the original error
                if isinstance(error, LossNotFiniteError):
                    self._keep_diverged(message)
                elif not interrupted and not isinstance(error, UserError):
                    self.directory.traceback.write_text(traceback.format_exc())
                    self.reporter.say(f"the traceback is in {self.directory.traceback}")
            self._end(message, "KILLED" if interrupted else "FAILED")
            if interrupted:
                raise KeyboardInterrupt from None
            raise
        self._end(None, "FINISHED")

    def _keep_diverged(self, message: str) -> None:
        """Mark a run stopped by a nan as finished: repeating the command would only reach the same nan."""
        timing = {"fit_s": float("nan"), "test_s": float("nan")}
        results = {"outcome": "diverged", "metrics": {}, "message": message, "parameters": 0, "timing": timing}
        write_json(self.directory.metrics, results | self.key.identity)

    def _end(self, failure: str | None, status: Literal["FINISHED", "FAILED", "KILLED"]) -> None:
        try:
            self.directory.update_state({"ended": time.time(), "failure": failure})
        except OSError as error:  # a full disk must not hide the original error
            self.reporter.say(f"could not note the end of the run: {error}")
        if self.mirror is not None:
            from sextant.tracking.mirror import finish_mirror
            from sextant.tracking.refill import send_again

            if not finish_mirror(self.mirror, self.directory, status):
                send_again(self.mirror.store, self.directory)


def execute_cell(raw: Mapping[str, Any], reporter: RunReporter = SILENT_RUN) -> dict[str, Any]:
    """Run one cell of a sweep like :func:`execute`, but report an error as an outcome so that the sweep goes on."""
    try:
        outcome = execute(raw, wait=True, reporter=reporter)
    except KeyboardInterrupt:
        raise
    except Exception as error:
        status: Status = "diverged" if isinstance(error, LossNotFiniteError) else "failed"
        outcome = Outcome(status, Path(), message=f"{type(error).__name__}: {error}")
        reporter.say(f"{_run_name(raw)} {status}: {outcome.message}")
    return asdict(outcome) | {"directory": str(outcome.directory)}


def _run_name(raw: Mapping[str, Any]) -> str:
    """The name of the run of a config, which may be wrong."""
    try:
        config = checked(raw)
        return f"{config.task.name}/{run_digest(config)[:8]}-s{config.seed}"
    except UserError:
        return "a run"


def _flat(node: Any, prefix: str = "") -> dict[str, Any]:
    if not isinstance(node, Mapping):
        return {prefix.rstrip("."): node}
    return {key: value for name, inner in node.items() for key, value in _flat(inner, f"{prefix}{name}.").items()}
