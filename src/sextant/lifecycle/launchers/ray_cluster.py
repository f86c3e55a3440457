"""Cells as tasks of a Ray cluster, for clusters without SLURM. The tasks end with the controller."""

import os
from typing import Any

from sextant.config.schema.launchers import RayLauncher
from sextant.errors import UserError
from sextant.lifecycle.launchers.cells import Cells, Outcomes, failed, finished, run_words
from sextant.lifecycle.run_reporter import RunReporter

#: environment variables of this process that are passed on to workers on other hosts
HANDED_ON = ("PYTHONPATH", "OMP_NUM_THREADS", "SEXTANT_OUTPUTS", "SEXTANT_DATA")


def run_on_ray(cells: Cells, launcher: RayLauncher, runs: RunReporter) -> Outcomes:
    """Run cells on the workers of a cluster; a cell whose worker or node dies is restarted elsewhere.

    Raises:
        UserError: no cluster answers at ``launcher.address``.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no telemetry
    import ray
    from ray.exceptions import RayError

    environment = {name: os.environ[name] for name in HANDED_ON if name in os.environ}
    try:
        ray.init(
            address=launcher.address or "local",
            runtime_env={"env_vars": environment},
            include_dashboard=False if launcher.address is None else None,
            configure_logging=False,
        )
    except (ConnectionError, RuntimeError) as error:
        raise UserError(
            f"launcher.address={launcher.address}: no Ray cluster answers: {str(error).splitlines()[0]}",
            "Start one: ray start --head; ray start --address=<host>:6379 on the others",
        ) from None
    try:
        remote: Any = ray.remote(run_words)
        start = remote.options(num_cpus=launcher.cpus, num_gpus=launcher.gpus, max_retries=launcher.attempts - 1)
        started = [start.remote(cell.words, runs) for cell in cells]
        outcomes: Outcomes = []
        for cell, reference in zip(cells, started, strict=True):
            try:
                outcomes.append(ray.get(reference))
            except RayError as error:
                reason = str(error).strip().splitlines()[0]
                outcomes.append(finished(cell.run) or failed(cell.run, f"{type(error).__name__}: {reason}"))
        return outcomes
    finally:
        ray.shutdown()
