"""Recognition by filters configured from single examples (chapter 6): the training of their network."""

from dataclasses import dataclass, field
from typing import Any

import pytorch_lightning as pl
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Int64
from numpy import ndarray
from torch import Tensor

from sextant.chapters.cosfire.estimator import CosfireEstimator
from sextant.chapters.cosfire.filter_prototypes import NoFilterError
from sextant.chapters.cosfire.methods import Method
from sextant.corruptions import CorruptionSuite
from sextant.data.batches import Batch
from sextant.data.examples import ExampleData
from sextant.errors import UserError
from sextant.evaluation import classification_converged
from sextant.training.schedules import OptimizerFactory, Schedule, log_training_loss, nothing_to_optimize, optimizers
from sextant.training.steps import StepLosses


@dataclass
class RecognitionResult:
    """Predictions on the test images.

    Attributes:
        labels: true classes.
        answers: predicted classes by method.
        conditions: by name, which images are of that condition; empty if all are of one.
        corrupted: predicted classes by method of the same images under corruptions, by key of the test condition.
    """

    labels: Int64[ndarray, "n"]
    answers: dict[Method, Int64[ndarray, "n"]] = field(default_factory=dict)
    conditions: dict[str, Bool[ndarray, "n"]] = field(default_factory=dict)
    corrupted: dict[str, dict[Method, Int64[ndarray, "n"]]] = field(default_factory=dict)

    def accuracy(self) -> dict[Method, float]:
        """Share of correct predictions by method."""
        return {method: float((found == self.labels).mean()) for method, found in self.answers.items()}

    def accuracy_under(self, condition: str) -> dict[Method, float]:
        """The same for the images of one condition."""
        rows = self.conditions[condition]
        return {method: float((found == self.labels)[rows].mean()) for method, found in self.answers.items()}

    def accuracies(self) -> dict[str, dict[Method, float]]:
        """Accuracy by method under all names: ``""`` of all clean images, ``/<condition>``, and ``/<corruption>``."""
        found = {"": self.accuracy()} | {f"/{name}": self.accuracy_under(name) for name in self.conditions}
        return found | {f"/{key}": RecognitionResult(self.labels, a).accuracy() for key, a in self.corrupted.items()}

    def headline(self, method: Method) -> dict[str, float]:
        """Accuracy of a method by key of the test condition, ``clean`` first."""
        found = self.accuracies()
        return {"clean": found[""][method]} | {key: found[f"/{key}"][method] for key in self.corrupted}

    def arrays(self) -> dict[str, ndarray]:
        """Labels, predictions and conditions, as stored by a run; corrupted ones as ``corrupted/<method>/<key>``."""
        answers = {f"answer/{method}": found for method, found in self.answers.items()}
        conditions = {f"condition/{name}": found for name, found in self.conditions.items()}
        corrupted = {f"corrupted/{m}/{key}": a for key, of in self.corrupted.items() for m, a in of.items()}
        return {"labels": self.labels, **answers, **conditions, **corrupted}


class CosfireRecognition(pl.LightningModule):
    """Trains the network of an estimator, if it has one; then fits the estimator to the examples.

    Args:
        estimator: its modules become this module's, so that checkpoints name arrays as its own ``state_dict`` does.
        suite: the test conditions; None for clean images alone.
        optimizer, schedule, log_every: as for every task.
    """

    monitor, monitor_mode = "val/accuracy", "max"
    estimator: CosfireEstimator

    def __init__(
        self,
        estimator: CosfireEstimator,
        suite: CorruptionSuite | None = None,
        *,
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        log_every: int = 50,
    ):
        super().__init__()
        self.automatic_optimization = estimator.network is not None
        object.__setattr__(self, "estimator", estimator)  # its modules are registered, not the estimator itself
        for name, part in estimator.named_children():
            self.add_module(name, part)
        self.suite = suite or CorruptionSuite()
        self.optimizer_factory, self.schedule = optimizer, schedule
        self.step_losses = StepLosses(log_every)
        self.result: RecognitionResult | None = None
        self._validation: list[Tensor] = []

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor | None:
        """Cross-entropy of the network; None without a network to train."""
        if self.estimator.network is None:
            self.optimizers().step()  # type: ignore[union-attr]
            return None
        loss = F.cross_entropy(self.estimator.network(batch.images_in_unit_range()), batch.labels)
        log_training_loss(self, self.step_losses.add(self.global_step, loss))
        return loss

    def on_train_epoch_end(self) -> None:
        """Log the remaining losses; after the last epoch, fit to the examples."""
        log_training_loss(self, self.step_losses.flush())
        if self.trainer.current_epoch + 1 == self.trainer.max_epochs:
            was = self.training
            self.eval()
            self._fit()
            self.train(was)

    def _fit(self) -> None:
        """Fit to the examples; on failure, the error points to the network if that has learnt little."""
        examples, tuning = self._data.split("examples"), self._data.split("tuning")
        try:
            self.estimator.fit(examples.images, examples.labels, (tuning.images, tuning.labels))
        except NoFilterError as error:
            accuracy = self.trainer.callback_metrics.get("val/accuracy")
            if accuracy is None or self.converged({"val/accuracy": float(accuracy)}):
                raise
            raise UserError(
                f"{error.problem}; the network has learnt little, its validation accuracy is "
                f"{100 * float(accuracy):.0f} %",
                f"Train it longer or differently: trainer.max_epochs, optimizer.lr, optimizer. {error.fix}",
            ) from None

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Count the network's correct predictions."""
        if self.estimator.network is not None:
            answers = self.estimator.network(batch.images_in_unit_range()).argmax(1)
            self._validation.append((answers == batch.labels).float())

    def on_validation_epoch_end(self) -> None:
        """Log ``val/accuracy`` of the network, or without a network that of the filters on the tuning images."""
        if self._validation:
            self.log("val/accuracy", torch.cat(self._validation).mean())
            self._validation = []
        elif len(self.estimator.filters) and len(tuning := self._data.split("tuning")):
            answers = self.estimator.first_scores(tuning.images).argmax(1)
            self.log("val/accuracy", (answers == tuning.labels).float().mean())

    def test_step(self, batch: Batch, batch_idx: int) -> None:
        """Do nothing: methods process all test images at once when the test ends."""

    def on_test_epoch_end(self) -> None:
        """Keep the answers as :attr:`result`; log ``test/accuracy/<method>``, and by condition and corruption."""
        split = self._data.split("test")
        rows = torch.arange(0, len(split), self._data.test_every)
        conditions = {name: found[rows.numpy()] for name, found in self._data.test_conditions().items()}
        images, labels, positions = split.images[rows], split.labels[rows], self._data.test_positions[rows.numpy()]
        self.suite.check_labels(labels, torch.from_numpy(positions))
        answers = self.estimator.answers(images)
        pixels = images.permute(0, 2, 3, 1).numpy()
        corrupted = {}
        for under in self.suite.conditions()[1:]:
            seen = torch.from_numpy(self.suite.corrupt_bytes(pixels, positions, under)).permute(0, 3, 1, 2)
            corrupted[under.key] = self.estimator.answers(seen.contiguous())
        self.result = RecognitionResult(labels.numpy(), answers, conditions, corrupted)
        for name, accuracy in self.result.accuracies().items():
            self.log_dict({f"test/accuracy/{method}{name}": value for method, value in accuracy.items()})

    def configure_optimizers(self) -> Any:
        """The optimiser of the network, with the schedule stepped once per epoch."""
        if self.estimator.network is None:
            return nothing_to_optimize()
        return optimizers(self, self.optimizer_factory, self.schedule)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the network learnt at all, by the rule for classification; filters are not judged."""
        if self.estimator.network is None:
            return True
        return classification_converged(validation["val/accuracy"], len(self._data.learnt))

    @property
    def _data(self) -> ExampleData:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]
