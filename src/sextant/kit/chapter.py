"""The interface between chapters and the life cycle of a run."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Protocol, TypeVar

from sextant.atomic_files import file_sha256
from sextant.config import Config
from sextant.config.schema.images import PerturbationSuite, StoredSuite, TestConditions
from sextant.config.schema.networks import TimmBackbone
from sextant.errors import UserError
from sextant.reporter import SILENT, Reporter
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    import numpy as np
    import pytorch_lightning as pl
    from matplotlib.figure import Figure
    from torch import nn

    from sextant.kit.measure import RunValues, SharedSet

#: content of a checkpoint from :func:`~sextant.kit.trained.read_trained`
Content = Mapping[str, Any]

Kind = TypeVar("Kind", bound=Config)


class Source(Protocol):
    """A dataset that can be checked and hashed before anything is trained on it."""

    name: str

    def files(self, split: Any) -> list[Path]:
        """The files of a split; raises a ``MissingDataError`` if one is missing."""

    def fingerprint(self) -> str:
        """A hash that changes with the data."""


@dataclass(frozen=True)
class TestRecord:
    """The results of a test beyond the logged metrics.

    Attributes:
        arrays: results per image.
        figures: named figures, made lazily.
        metrics: further metrics.
        table: rows of a comparison, each a mapping from column to text.
        facts: further facts to store with the results, as plain values.
        files: further files or folders in the run directory, each with the function that writes it.
    """

    arrays: "dict[str, np.ndarray]"
    figures: "Iterator[tuple[str, Figure]]"
    metrics: dict[str, float] = field(default_factory=dict)
    table: list[dict[str, str]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    files: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)


class Chapter(ABC, Generic[Kind]):
    """Builds and tests the parts of one task, whose runs have configs of kind ``Kind``.

    Methods marked *light* import nothing heavy.

    Attributes:
        about: what the task is for, in a sentence with the chapter of the thesis.
        evaluation_example: arguments of ``evaluate.py`` to suggest as a next step.
        splits: splits of the dataset that a run reads.
        fits_elsewhere: whether ``dataset.fit_world`` may name another world, in which everything is fitted.
        monitor: validation metric that selects checkpoints, and whether its "max" or "min" is best.
        sweep_example: a group or key and two values, compared in a sweep that is suggested as a next step.
        cannot_test: kinds of the group ``corruption`` under which the task is not tested; most can only be tested under
            corruptions that are drawn.
        alone: why it is trained in a single process and uncompiled, if it is.
        on_cpu: why a GPU would not help, if it computes only on the CPU.
        test_settings: keys of ``task`` that control testing and may change after training.
        reporter: listens to long work.
    """

    about: ClassVar[str]
    evaluation_example: ClassVar[tuple[str, ...]]
    monitor: ClassVar[tuple[str, Literal["max", "min"]]]
    sweep_example: ClassVar[tuple[str, tuple[str, str]]]
    cannot_test: ClassVar[tuple[type[TestConditions], ...]] = (StoredSuite, PerturbationSuite)
    splits: ClassVar[tuple[str, ...]] = ("train", "val", "test")
    fits_elsewhere: ClassVar[bool] = False
    alone: ClassVar[str] = ""
    on_cpu: ClassVar[str] = ""
    test_settings: ClassVar[tuple[str, ...]] = ()

    def __init__(self, reporter: Reporter = SILENT):
        self.reporter = reporter

    def evaluation_words(self, config: Kind) -> tuple[str, ...]:
        """:attr:`evaluation_example`, adapted to the training data of a run."""
        return self.evaluation_example

    def prediction_example(self, config: Kind) -> tuple[str, ...]:
        """Arguments of ``predict.py`` that name the input of a run; none if the run predicts nothing. Light."""
        return ("input=<folder>",)

    def check_parts(self, config: Kind) -> None:
        """Raise a ``UserError`` if choices of several groups are incompatible. Light."""
        suite, trainer = config.corruption, config.trainer
        for key, asked in (("devices", trainer.devices > 1), ("compile", trainer.compile)):
            if asked and self.alone:
                raise UserError(
                    f"trainer.{key}={getattr(trainer, key)}: task={config.task.name} {self.alone}",
                    "trainer.devices=1 trainer.compile=false",
                )
        if self.on_cpu and trainer.accelerator == "gpu":
            told = f"trainer.accelerator=gpu: task={config.task.name} {self.on_cpu}"
            raise UserError(told, "trainer.accelerator=cpu")
        if isinstance(suite, self.cannot_test):
            kind = "files" if isinstance(suite, StoredSuite) else "sequences"
            raise UserError(
                f"corruption: task={config.task.name} draws the corruptions of its images and cannot use {kind}",
                "corruption=cifar10_c for small images, corruption=imagenet_c, or corruption=none",
            )

    def identity(self, config: Kind) -> dict[str, Any]:
        """The identity of a run: its config as plain values, with hashes of files in place of paths. Light.

        Raises:
            UserError: a file does not exist.
        """
        typed = config.model_dump(by_alias=True)
        if config.init_from is not None:
            typed["init_from"] = resolve_run(config.init_from, Path(config.paths.outputs), "init_from").identity
        if isinstance(config.corruption, StoredSuite):
            from sextant.corruptions.stored_suite import folder_identity

            typed["corruption"]["folder"] = folder_identity(config.corruption.folder)
        backbone = getattr(config, "backbone", None)
        if isinstance(backbone, TimmBackbone) and backbone.weights is not None:
            path = Path(backbone.weights).expanduser()
            if path.is_file():  # testing a trained network does not need the file
                typed["backbone"]["weights"] = file_sha256(path)
        return typed

    def answers(self, config: Kind) -> list[str]:
        """The methods whose answers a run stores separately, if several; an arm of a sweep reads one of them. Light."""
        return []

    @abstractmethod
    def source(self, config: Kind) -> Source:
        """The dataset. Light.

        Raises:
            UserError: this chapter cannot use the dataset.
        """

    def check(self, source: Source) -> None:
        """Raise a ``UserError`` if files of :attr:`splits` are missing; a world to be rendered needs none. Light."""
        for split in self.splits:
            source.files(split)

    def training_size(self, config: Kind, source: Any) -> int | None:
        """The number of images in an epoch, which limits the batch size; None if unknown before reading. Light."""
        return None

    @abstractmethod
    def summary(self, config: Kind) -> dict[str, str]:
        """The summary that a run shows before it starts. Light."""

    def batches(self, config: Kind) -> str:
        """The content of an epoch, for that summary."""
        return f" of batches of {config.trainer.batch_size}"

    @abstractmethod
    def data(self, config: Kind, source: Any) -> "pl.LightningDataModule":
        """The data module with training, validation and test batches."""

    @abstractmethod
    def spec(self, config: Kind, source: Any, data: Any) -> dict[str, Any]:
        """Plain facts about the data from which the model is built; its checkpoints store them."""

    @abstractmethod
    def module(self, config: Kind, spec: Mapping[str, Any], *, training: bool) -> Any:
        """The Lightning module; ``training=False`` omits optimiser and schedule."""

    @abstractmethod
    def require_fit(self, config: Kind, spec: Mapping[str, Any], source: Any) -> None:
        """Raise a ``UserError`` unless a model of ``spec`` can be tested on ``source``."""

    @abstractmethod
    def record(self, module: Any, data: Any, config: Kind) -> TestRecord:
        """The results of the test that the module has just run."""

    @abstractmethod
    def measured(
        self, arrays: "Mapping[str, np.ndarray]", shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """The measure of a run for reports, and the value of each test image under each condition.

        Args:
            arrays: arrays of the run's ``predictions.npz``, as :meth:`record` returned them.
            shared: the conditions of a published set that all runs of a sweep share, if they were tested under one.
            reads: the method whose answers count, one of :meth:`answers`.

        Raises:
            KeyError: the arrays are not those of a run of this task.
        """

    def new_network(self, config: Kind, spec: Mapping[str, Any]) -> "nn.Module":
        """The network alone, with new weights, where other tasks may use one of its layers.

        Raises:
            UserError: a part cannot be built.
        """
        raise NotImplementedError
