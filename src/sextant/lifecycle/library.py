"""The life cycle as calls of a library: ``sextant.run``, ``sextant.sweep``, ``sextant.evaluate``."""

from collections.abc import Sequence
from pathlib import Path

from sextant.composing.config_files import own_configs
from sextant.lifecycle.checks import preflight
from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.execute import Outcome, execute
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.lifecycle.search.run import sweep_or_search
from sextant.lifecycle.sweep import SweepOutcome
from sextant.lifecycle.sweep_plan import check_sweep_overrides
from sextant.tracking.environment import quiet_libraries


def run(
    overrides: Sequence[str] = (), *, config_dir: str | Path | None = None, reporter: RunReporter = SILENT_RUN
) -> Outcome:
    """Train and test what overrides describe, as ``train.py`` does, unless it is finished already.

    Args:
        overrides: of the config: groups such as ``dataset=mnist``, values such as ``optimizer.lr=0.05``.
        config_dir: folder of config files of one's own, ``<group>/<option>.yaml``, beside those shipped.
        reporter: listens to the run; silent unless one is given.

    Raises:
        UserError: a mistake in an override or in the data, or a loss that became nan.

    Example:
        >>> import sextant
        >>> outcome = sextant.run(["inhibition=push_pull", "trainer=fast"])  # doctest: +SKIP
        >>> outcome.status, outcome.metrics["test/accuracy/clean"]  # doctest: +SKIP
    """
    quiet_libraries()
    with own_configs(config_dir):
        raw = preflight(overrides, reporter)
    return execute(raw, reporter=reporter)


def sweep(
    name: str | None = None,
    overrides: Sequence[str] = (),
    *,
    workers: int = 1,
    config_dir: str | Path | None = None,
    reporter: RunReporter = SILENT_RUN,
) -> SweepOutcome:
    """Run what is missing of a sweep, as ``train.py -m`` does; a run that fails is an outcome, and the others go on.

    Args:
        name: of a stored sweep; without one, the sweep is of all overrides that list several values, and the last of
            these (apart from the seed) is what is compared.
        overrides: of the config, such as ``sweep.seeds=3`` or ``inhibition=none,push_pull``.
        workers: how many processes on this machine; 1 runs one cell after another in this one. For a cluster, say so
            in ``overrides``: ``launcher=slurm``.
        config_dir: as for :func:`run`.
        reporter: listens to the sweep, not to its runs.

    Raises:
        UserError: a cell's config is wrong; nothing was run then.

    Example:
        >>> import sextant
        >>> found = sextant.sweep("demo", ["sweep.seeds=3"], workers=2)  # doctest: +SKIP
        >>> found.count("finished"), found.directory  # doctest: +SKIP
    """
    quiet_libraries()
    arguments = [*([] if name is None else [f"sweep={name}"]), *overrides]
    if not any(override.startswith("launcher=") for override in overrides):
        arguments += ["launcher=local"] if workers == 1 else ["launcher=joblib", f"launcher.workers={workers}"]
    with own_configs(config_dir):
        check_sweep_overrides(arguments)
        return sweep_or_search(arguments, reporter)


def evaluate(run: str | Path, overrides: Sequence[str] = (), *, reporter: RunReporter = SILENT_RUN) -> Outcome:
    """Test a trained run under other data or conditions, as ``evaluate.py`` does.

    Args:
        run: an MLflow run id, a run directory, a checkpoint or a published ``.pth.tar``.
        overrides: such as ``corruption=gaussian``; ``sextant evaluate --help`` lists what may change.
        reporter: listens.

    Raises:
        UserError: there is no such run, an override is wrong, or the model does not fit the data.
    """
    quiet_libraries()
    return evaluate_run(str(run), overrides, reporter)
