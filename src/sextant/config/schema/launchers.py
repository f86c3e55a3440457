"""Launchers, which determine where the runs of a sweep are computed."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import Node
from sextant.ranges import Count, Positive


class Launcher(Node):
    """Settings common to all launchers.

    Attributes:
        lease_s: seconds without a sign of life after which another host takes over a run. On the same host, the run of
            a dead process is taken over at once.
    """

    lease_s: Positive = Field(default=60.0, examples=[60])


class LocalLauncher(Launcher):
    """One run after another in this process."""

    kind: Literal["local"] = "local"


class JoblibLauncher(Launcher):
    """Several processes on this machine; ``workers`` null uses one per core."""

    kind: Literal["joblib"]
    workers: Count | None = Field(default=None, examples=[4])


class SlurmLauncher(Launcher):
    """Job arrays on a SLURM cluster.

    Attributes:
        wait: whether to wait for the runs; false submits and returns.
        time_min: time limit of a task, in minutes; a task that reaches it is requeued and resumes from its checkpoint.
        cpus, gpus, memory_gb: resources of a task.
        at_once: number of tasks of the array that may run at the same time.
        cells_per_task: number of runs that a task computes one after another.
        attempts: number of times a run is submitted if its task vanishes without a trace.
        srun: whether to start the tasks with srun, as a step of the job.
        setup: shell lines to run before each task, such as ``module load cuda``.
        options: further options of sbatch, such as ``{constraint: a100}``.
    """

    kind: Literal["slurm"]
    wait: bool = True
    partition: str | None = Field(default=None, examples=["gpu"])
    account: str | None = None
    qos: str | None = None
    time_min: Count = Field(default=60, examples=[60])
    cpus: Count = Field(default=1, examples=[4])
    gpus: int = Field(default=0, ge=0, examples=[1])
    memory_gb: Positive | None = Field(default=None, examples=[8])
    at_once: Count | None = Field(default=None, examples=[16])
    cells_per_task: Count = Field(default=1, examples=[10])
    attempts: Count = Field(default=3, examples=[3])
    srun: bool = True
    setup: list[str] = Field(default_factory=list)
    options: dict[str, Any] = Field(default_factory=dict)


class RayLauncher(Launcher):
    """Workers of a Ray cluster.

    Attributes:
        address: address of the cluster, ``auto`` for that of this machine; null starts one on this machine.
        cpus, gpus: resources of a run.
        attempts: number of times a run is started if its worker dies.
    """

    kind: Literal["ray"]
    address: str | None = Field(default=None, examples=["auto"])
    cpus: Count = Field(default=1, examples=[1])
    gpus: float = Field(default=0, ge=0, examples=[1])
    attempts: Count = Field(default=3, examples=[3])

    @model_validator(mode="after")
    def _client_mode_is_not_used(self) -> Self:
        if (self.address or "").startswith("ray://"):
            raise ValueError(
                f"launcher.address={self.address}: start the sweep on a host of the cluster, with launcher.address=auto"
            )
        return self


AnyLauncher = Annotated[LocalLauncher | JoblibLauncher | SlurmLauncher | RayLauncher, Field(discriminator="kind")]
