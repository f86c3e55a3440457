"""What ``predict.py`` asks of a task. Nothing heavy is imported, so that mistakes in a command are reported at once."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import FoundRun, resolve_run


@dataclass(frozen=True)
class Trained:
    """The model that ``run=`` names.

    Attributes:
        reference: what the user wrote.
        found: the run and its checkpoint.
        content: of the checkpoint.
        trust: parts of the user's own that it names may be built.
    """

    reference: str
    found: FoundRun
    content: Mapping[str, Any]
    trust: bool

    @property
    def about(self) -> Mapping[str, Any]:
        """The config, the task and what else a checkpoint has beside the weights."""
        from sextant.runs.checkpoint import KEY

        about: Mapping[str, Any] = self.content[KEY]
        return about

    @property
    def task(self) -> str:
        """That it was trained for."""
        return str(self.about["task"])


class Handler:
    """A task as ``predict.py`` sees it: its keys, and what is done with them.

    Attributes:
        task: as runs name it, in messages.
        topic: what ``--help`` puts before its keys.
        usage: an example.
        keys: that only this task has, with what they mean.
        needs: keys without which nothing can be done.
        shared: keys that other tasks have too.
        named_by: the keys that name the task before the run does, in messages; "" if the run names it.
    """

    task: ClassVar[str]
    usage: ClassVar[str] = (
        "sextant predict run=<MLflow run id, run directory or checkpoint> input=<image, folder or pattern> "
        "output=<folder>"
    )
    topic: ClassVar[str] = ""
    keys: ClassVar[Mapping[str, str]] = {}
    needs: ClassVar[tuple[str, ...]] = ("run", "input", "output")
    shared: ClassVar[tuple[str, ...]] = ("run", "input", "output", "outputs", "trust")
    named_by: ClassVar[str] = ""

    def claims(self, given: Mapping[str, str]) -> bool:
        """Whether the arguments alone name this task; otherwise the checkpoint does.

        Raises:
            UserError: they name it and something else.
        """
        return False

    def check(self, given: Mapping[str, str]) -> None:
        """Raise a ``UserError`` if a value of its keys has no meaning, before the checkpoint is read."""

    def predict(self, given: Mapping[str, str]) -> None:
        """Do what arguments that it claims ask for: predict, show and write."""
        raise NotImplementedError

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Predict, show and write what a model of this task makes of photos.

        Args:
            given: the arguments, for those of its keys.
            trained: the model.
            paths: of the photos.
            output: a folder that is there.

        Raises:
            UserError: nothing can be made of them.
        """
        raise UserError(
            f"run={trained.reference} is a model of task={trained.task}, which predict.py does not know",
            "The checkpoint was altered, or written by another version of Sextant.",
        )


def require(given: Mapping[str, str], keys: tuple[str, ...], usage: str) -> None:
    """Raise a ``UserError`` unless all of these keys are given."""
    for key in keys:
        if key not in given:
            raise UserError(f"{key}= is missing", usage)


def outputs_of(given: Mapping[str, str]) -> Path:
    """The folder of runs."""
    return Path(given["outputs"]).absolute() if "outputs" in given else default_outputs()


def find_run(given: Mapping[str, str]) -> FoundRun:
    """The run that ``run=`` names.

    Raises:
        UserError: there is none.
    """
    return resolve_run(given["run"], outputs_of(given))


def open_run(given: Mapping[str, str]) -> Trained:
    """The model that ``run=`` names, read: this imports torch.

    Raises:
        UserError: there is no such run, or its checkpoint is damaged.
    """
    found = find_run(given)
    from sextant.trained.content import read_trained

    return Trained(given["run"], found, read_trained(found.checkpoint), given.get("trust") == "true")
