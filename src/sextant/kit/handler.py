"""The interface of tasks to ``predict.py``. Imports nothing heavy, so that mistakes are reported at once."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

from sextant.errors import UserError
from sextant.registry import CHAPTERS
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import FoundRun, resolve_run


@dataclass(frozen=True)
class Trained:
    """The model that ``run=`` names.

    Attributes:
        reference: what the user wrote.
        found: the run and its checkpoint.
        content: content of the checkpoint.
        trust: whether parts from outside Sextant that it names may be built.
    """

    reference: str
    found: FoundRun
    content: Mapping[str, Any]
    trust: bool

    @property
    def about(self) -> Mapping[str, Any]:
        """The metadata of the checkpoint: config, task and everything else but the weights."""
        from sextant.runs.checkpoint import KEY

        about: Mapping[str, Any] = self.content[KEY]
        return about

    @property
    def task(self) -> str:
        """The task for which it was trained."""
        return str(self.about["task"])


class Handler:
    """A task in ``predict.py``: its keys, and the function for them.

    Attributes:
        task: name of the task in runs, for messages.
        topic: prefix of its keys in ``--help``.
        usage: an example.
        keys: keys that only this task has, with their meanings.
        needs: keys that are required.
        shared: keys that it shares with other tasks.
        named_by: keys that name the task before the run does, for messages; "" if the run names it.
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
            UserError: the arguments name it and another task.
        """
        return False

    def check(self, given: Mapping[str, str]) -> None:
        """Raise a ``UserError`` if a value of its keys is invalid, before the checkpoint is read."""

    def predict(self, given: Mapping[str, str]) -> None:
        """Predict for arguments claimed by this task, and show and write the results."""
        raise NotImplementedError

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Predict photos with a model of this task, and show and write the results.

        Args:
            given: the arguments, including those of its own keys.
            trained: the model.
            paths: paths of the photos.
            output: an existing folder.

        Raises:
            UserError: the photos cannot be predicted.
        """
        raise UserError(
            f"run={trained.reference} is a model of task={trained.task}, which predict.py does not support",
            "The checkpoint was altered, or written by another version of Sextant.",
        )


def require(given: Mapping[str, str], keys: tuple[str, ...], usage: str) -> None:
    """Raise a ``UserError`` unless all of these keys are given."""
    for key in keys:
        if key not in given:
            raise UserError(f"{key}= is missing", usage)


def outputs_of(given: Mapping[str, str]) -> Path:
    """The folder of runs."""
    return Path(given["outputs"]).expanduser().absolute() if "outputs" in given else default_outputs()


def find_run(given: Mapping[str, str]) -> FoundRun:
    """The run that ``run=`` names.

    Raises:
        UserError: the run does not exist.
    """
    return resolve_run(given["run"], outputs_of(given))


def open_run(given: Mapping[str, str]) -> Trained:
    """Load the model that ``run=`` names, which imports torch.

    Raises:
        UserError: the run does not exist, or its checkpoint is damaged.
    """
    found = find_run(given)
    from sextant.kit.trained import read_trained

    return Trained(given["run"], found, read_trained(found.checkpoint), given.get("trust") == "true")


def handlers() -> list[Handler]:
    """What ``predict.py`` does for each task, in the order of :data:`~sextant.registry.CHAPTERS`."""
    return [handler() for package in CHAPTERS.values() for handler in import_module(f"{package}.commands").HANDLERS]
