"""Image classification, tested under corruptions not trained on (chapter 7)."""

from typing import Any

import pytorch_lightning as pl
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from sextant.chapters.classification.report import condition_metrics
from sextant.chapters.classification.result import ClassificationResult
from sextant.corruptions import Condition, CorruptionSuite, PerturbationSuite
from sextant.data.batches import Batch
from sextant.data.source import ImageSpec
from sextant.evaluation import classification_converged
from sextant.evaluation.confidence import BINS, Confidence
from sextant.layers import implementations, skipped
from sextant.models import network_cost
from sextant.training.schedules import OptimizerFactory, Schedule, log_training_loss, optimizers
from sextant.training.steps import StepLosses


class Classification(pl.LightningModule):
    """Trains a network with cross-entropy and tests it under each condition of a corruption suite.

    Args:
        network: maps images in [0, 1], ``(b, c, h, w)``, to logits ``(b, k)``.
        spec: shape of the images, and their classes.
        suite: the test conditions.
        optimizer: builds the optimiser from the parameters; None for a model that is only evaluated.
        schedule: factor on the learning rate as a function of the share of epochs done.
        log_every: steps between two logged training losses.
    """

    monitor, monitor_mode = "val/accuracy", "max"

    def __init__(
        self,
        network: nn.Module,
        spec: ImageSpec,
        suite: CorruptionSuite,
        *,
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        log_every: int = 50,
    ):
        super().__init__()
        self.network, self.spec, self.suite = network, spec, suite
        self.optimizer_factory, self.schedule = optimizer, schedule
        self.step_losses = StepLosses(log_every)
        self.result: ClassificationResult | None = None
        self._validation: list[Tensor] = []
        self._test: dict[Condition, list[Tensor]] = {}
        self._beliefs: dict[Condition, list[Confidence]] = {}
        self._test_labels: list[Tensor] = []
        self._test_indices: list[Tensor] = []

    def forward(self, images: Tensor) -> Tensor:
        """Logits ``(b, k)`` of images in [0, 1], ``(b, c, h, w)``."""
        return self.network(images)  # type: ignore[no-any-return]

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Cross-entropy of a batch."""
        loss = batch.weight * F.cross_entropy(self(batch.images_in_unit_range()), batch.labels)
        log_training_loss(self, self.step_losses.add(self.global_step, loss))
        return loss

    def on_train_epoch_end(self) -> None:
        """Check and log the losses since the last logged one, so that no epoch ends unchecked."""
        log_training_loss(self, self.step_losses.flush())

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Count correct predictions and add up the loss."""
        logits = self(batch.images_in_unit_range())
        correct = (logits.argmax(1) == batch.labels).sum()
        loss = F.cross_entropy(logits, batch.labels, reduction="sum")
        count = torch.tensor(float(len(batch.labels)), device=loss.device)
        self._validation.append(torch.stack([correct.float(), loss.float(), count]))

    def on_validation_epoch_end(self) -> None:
        """Log ``val/accuracy`` and ``val/loss``."""
        correct, loss, count = torch.stack(self._validation).sum(0)
        self._validation = []
        metrics = {"val/accuracy": correct / count, "val/loss": loss / count}
        self.log_dict(metrics)

    def test_step(self, batch: Batch, batch_idx: int) -> None:
        """Predict a batch under every condition."""
        self.suite.check_labels(batch.labels, batch.indices)
        images = batch.images_in_unit_range()
        for condition in self.suite.conditions():
            logits = self(self.suite.corrupt(images, batch.indices, condition))
            self._test.setdefault(condition, []).append(logits.argmax(1).cpu())
            if condition.corruption is None or not isinstance(self.suite, PerturbationSuite):
                self._beliefs.setdefault(condition, []).append(Confidence.of_logits(logits, batch.labels))
        self._test_labels.append(batch.labels.cpu())
        self._test_indices.append(batch.indices.cpu())

    def on_test_epoch_end(self) -> None:
        """Keep the predictions as :attr:`result`; log accuracies, errors of a published set, or flip probabilities."""
        small = torch.uint8 if len(self.spec.classes) <= 256 else torch.int64
        predictions = {c.key: torch.cat(chosen).to(small).numpy() for c, chosen in self._test.items()}
        labels, indices = torch.cat(self._test_labels).numpy(), torch.cat(self._test_indices).numpy()
        confidences = {c.key: Confidence.joined(parts) for c, parts in self._beliefs.items()}
        self.result = ClassificationResult(labels, indices, predictions, confidences)
        self._test, self._beliefs, self._test_labels, self._test_indices = {}, {}, [], []
        self.log_dict(condition_metrics(self.result, self.suite) | self.result.trust())

    def configure_optimizers(self) -> Any:
        """The optimiser, with the schedule stepped once per epoch."""
        return optimizers(self, self.optimizer_factory, self.schedule)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the run learnt at all, on the validation split and by the rule in ``evaluation.protocols``."""
        return classification_converged(validation["val/accuracy"], len(self.spec.classes))

    def facts(self) -> dict[str, Any]:
        """The network's multiplications per image, how its inhibition is computed, and the protocol of the test."""
        size = (self.spec.height, self.spec.width)
        cost = network_cost(self.network, size, self.spec.channels)
        image = torch.zeros(1, self.spec.channels, *size, device=self.device)
        found = {
            "multiplications": cost.macs,
            "pull_multiplications": cost.pull_macs,
            "inhibition": implementations(self.network, image),
        } | ({"without_inhibition": left} if (left := skipped(self.network)) else {})
        protocol = self.suite.protocol
        return {"cost": found, "confidence": {"ece_bins": BINS}} | (
            {} if protocol is None else {"protocol": protocol.as_dict()}
        )
