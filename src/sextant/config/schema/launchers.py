"""Where the runs of a sweep are computed."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import Count, Node, Positive


class Launcher(Node):
    """What all launchers have.

    Attributes:
        lease_s: a run whose process was not heard of for so many seconds is taken over by another host; one of a
            process that died on the same host at once.
    """

    lease_s: Positive = Field(default=60.0, examples=[60])


class LocalLauncher(Launcher):
    """One run after another in this process."""

    kind: Literal["local"] = "local"


class JoblibLauncher(Launcher):
    """Several processes on this machine; ``workers`` null is one for each core."""

    kind: Literal["joblib"]
    workers: Count | None = Field(default=None, examples=[4])


class SlurmLauncher(Launcher):
    """Job arrays on a SLURM cluster.

    Attributes:
        wait: false submits and leaves.
        time_min: limit of a task, in minutes; one that reaches it is queued again and goes on from its checkpoint.
        cpus, gpus, memory_gb: of a task.
        at_once: how many tasks of the array may run at once.
        cells_per_task: runs that a task computes one after another.
        attempts: how often a run whose task vanished without a trace is submitted.
        srun: start the tasks with srun, as a step of the job.
        setup: lines of shell before each task, such as ``module load cuda``.
        options: further options of sbatch, ``{constraint: a100}``.
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
        address: of the cluster, ``auto`` for the one this machine is part of; null starts one on this machine.
        cpus, gpus: of a run.
        attempts: how often a run whose worker died is started.
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
