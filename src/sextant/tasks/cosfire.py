"""Recognition by filters that are configured from single examples (chapter 6), beside what they are compared with."""

import copy
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytorch_lightning as pl
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float32, Int64, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.data.batches import Batch, ImageBatches
from sextant.data.examples import ExampleData
from sextant.evaluation import classification_converged
from sextant.layers.cosfire import Cosfire
from sextant.models import FeatureMap
from sextant.tasks.filter_prototypes import Prototypes, PrototypeSettings, configure
from sextant.tasks.learnt_later import LearntLater
from sextant.tasks.optimizing import OptimizerFactory, Schedule, optimizers
from sextant.tasks.recognition_methods import (
    NEAREST_AMONG,
    OF_NETWORK,
    Method,
    nearest_example,
    strongest_filter,
    svm_of,
)
from sextant.tasks.representations import Progress, feature_maps, filter_maxima
from sextant.tasks.step_losses import StepLosses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: the methods that are a support vector machine
MACHINES: tuple[Method, ...] = ("cosfire_svm", "full_svm", "pooled_svm")


@dataclass(frozen=True)
class Comparison:
    """What is compared, and how machines are fitted.

    Attributes:
        methods: see :data:`~sextant.tasks.recognition_methods.METHODS`.
        prices: of an error, among which tuning images choose; a single one needs none.
        choose_among: examples of which machines are made while prices are compared.
        logarithms: machines see logarithms of the filters' maxima.
    """

    methods: tuple[Method, ...] = ("cosfire_svm", "strongest_filter", *OF_NETWORK)
    prices: tuple[float, ...] = (0.001, 0.01, 0.1, 1.0)
    choose_among: int = 5000
    logarithms: bool = False


@dataclass
class RecognitionResult:
    """Answers on the test images.

    Attributes:
        labels: true classes.
        answers: by method.
        conditions: which images are of it, by its name; empty where all are of one.
    """

    labels: Int64[ndarray, "n"]
    answers: dict[Method, Int64[ndarray, "n"]] = field(default_factory=dict)
    conditions: dict[str, Bool[ndarray, "n"]] = field(default_factory=dict)

    def accuracy(self) -> dict[Method, float]:
        """Share of right answers by method."""
        return {method: float((found == self.labels).mean()) for method, found in self.answers.items()}

    def accuracy_under(self, condition: str) -> dict[Method, float]:
        """The same for the images of one condition."""
        rows = self.conditions[condition]
        return {method: float((found == self.labels)[rows].mean()) for method, found in self.answers.items()}


class CosfireRecognition(pl.LightningModule):
    """Trains a network, if there is one to train; then configures filters and fits machines to the examples.

    Args:
        filters: makes the filters, from the feature map of the network or without.
        classes: names.
        prototypes, comparison: how.
        network: maps images to logits; None: filters look at images, or at ``features``.
        layer: of the network whose map filters look at.
        features: a feature map that was trained before and stays as it is, in place of ``network``.
        image_shape: channels, height and width.
        describe: place descriptors of images, for the method ``descriptor``.
        seed: of the choice of prototypes.
        show: progress of what takes long, by its name.
        optimizer, schedule, log_every: as for every task.
    """

    monitor, monitor_mode = "val/accuracy", "max"

    def __init__(
        self,
        filters: Callable[[FeatureMap | None], Cosfire],
        classes: tuple[str, ...],
        prototypes: PrototypeSettings,
        comparison: Comparison,
        *,
        image_shape: tuple[int, int, int],
        network: nn.Module | None = None,
        layer: str | None = None,
        features: FeatureMap | None = None,
        describe: Callable[[UInt8[ndarray, "n h w c"]], Float32[ndarray, "n d"]] | None = None,
        seed: int = 0,
        show: Callable[[str], AbstractContextManager[Progress]] = lambda what: nullcontext(lambda done, total: None),
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        log_every: int = 50,
    ):
        super().__init__()
        self.network, self.classes, self.image_shape = network, classes, image_shape
        self.automatic_optimization = network is not None
        if network is not None:
            features = FeatureMap(copy.deepcopy(network), image_shape[0], image_shape[1:], layer=layer)
        self.features = features
        if features is not None:
            features.requires_grad_(False)
        self.filters = filters(features)
        self.prototype_settings, self.comparison = prototypes, comparison
        self.describe, self.seed, self.show = describe, seed, show
        self.optimizer_factory, self.schedule = optimizer, schedule
        self.step_losses = StepLosses(log_every)
        self.prototypes = LearntLater("labels", "images", "points", "own", "pictures")
        self.machines = nn.ModuleDict(
            {name: LearntLater("weights", "bias", "price") for name in MACHINES if name in self.methods}
        )
        self.result: RecognitionResult | None = None
        self._validation: list[Tensor] = []

    @property
    def methods(self) -> list[Method]:
        """Those of the comparison that there are the parts for."""
        missing = set() if self.features is not None else set(OF_NETWORK)
        missing |= {"network"} if self.network is None else set()
        missing |= {"descriptor"} if self.describe is None else set()
        return [method for method in self.comparison.methods if method not in missing]

    # -- the network ---------------------------------------------------------------------------------------------------

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor | None:
        """Cross-entropy of the network; nothing without one to train."""
        if self.network is None:
            return None
        loss = F.cross_entropy(self.network(batch.images_in_unit_range()), batch.labels)
        self._log_training_loss(self.step_losses.add(self.global_step, loss))
        return loss

    def on_train_epoch_end(self) -> None:
        """Log what is left; learn from the examples when the last epoch is done."""
        self._log_training_loss(self.step_losses.flush())
        if self.trainer.current_epoch + 1 == self.trainer.max_epochs:
            was = self.training
            self.eval()
            self.learn(self._data)
            self.train(was)

    def _log_training_loss(self, loss: float | None) -> None:
        if loss is not None and self.logger is not None:
            rate = self.trainer.optimizers[0].param_groups[0]["lr"]
            self.logger.log_metrics({"train/loss": loss, "train/learning_rate": rate}, step=self.global_step)

    # -- examples ------------------------------------------------------------------------------------------------------

    def learn(self, data: ExampleData) -> None:
        """Configure filters from the examples, and fit the machines to them.

        Raises:
            UserError: no filter can be configured for a class.
        """
        if self.network is not None:
            assert self.features is not None
            kept = self.features.state_dict()
            self.features.load_state_dict({k: v for k, v in self._network_state().items() if k in kept})
        examples, tuning = data.split("examples"), data.split("tuning")
        generator = torch.Generator().manual_seed(self.seed)
        self.filters.clear()
        found = configure(self.filters, examples.images, examples.labels, self.prototype_settings, generator)
        self.prototypes.keep(
            labels=found.labels,
            images=found.images,
            points=found.points,
            own=found.own,
            pictures=examples.images[found.images],
        )
        for name, machine in self.machines.items():
            known = self._representation(name, examples)
            held = self._representation(name, tuning) if len(tuning) else known[:0]
            fitted = svm_of(
                (known, examples.labels),
                (held, tuning.labels),
                len(self.classes),
                self.comparison.prices,
                self.comparison.choose_among,
                self.seed,
            )
            machine.keep(  # type: ignore[operator]
                weights=torch.from_numpy(fitted.weights),
                bias=torch.from_numpy(fitted.bias),
                price=torch.tensor([fitted.c], dtype=torch.float64),
            )

    def _network_state(self) -> dict[str, Tensor]:
        assert self.network is not None
        return {f"network.{name}": value for name, value in self.network.state_dict().items()}

    def _representation(self, method: str, split: ImageBatches) -> Tensor:
        if method in ("cosfire_svm", "strongest_filter"):
            with self.show("filtering") as progress:
                maxima = filter_maxima(self.filters, split.images, progress)
            if method == "cosfire_svm" and self.comparison.logarithms:
                least = maxima[maxima > 0].min() if (maxima > 0).any() else torch.tensor(1.0)
                return maxima.clamp(min=float(least)).log()
            return maxima
        if method == "descriptor":
            assert self.describe is not None
            return torch.from_numpy(self.describe(split.images.permute(0, 2, 3, 1).contiguous().numpy()))
        assert self.features is not None
        return feature_maps(self.features, split.images, "pooled" if method == "pooled_svm" else "full")

    # -- validation and test -------------------------------------------------------------------------------------------

    def answers(self, split: ImageBatches, data: ExampleData) -> dict[Method, np.ndarray]:
        """The class that each method gives each image."""
        found: dict[Method, np.ndarray] = {}
        count = len(self.classes)
        for method in self.methods:
            if method in self.machines:
                machine = self.machines[method]
                features = self._representation(method, split).double()
                scores = features @ machine["weights"].T + machine["bias"]  # type: ignore[index]
            elif method == "strongest_filter":
                maxima = self._representation(method, split)
                scores = strongest_filter(maxima, self.prototypes["own"], self.prototypes["labels"], count)
            elif method == "network":
                scores = self._logits(split)
            else:
                examples = data.split("examples")
                known = ImageBatches(examples.images[:NEAREST_AMONG], examples.labels[:NEAREST_AMONG])
                maps, among = (self._representation(method, images) for images in (split, known))
                found[method] = nearest_example(maps, among, known.labels).numpy()
                continue
            found[method] = scores.argmax(1).numpy()
        return found

    def _logits(self, split: ImageBatches) -> Tensor:
        assert self.network is not None
        with torch.no_grad():
            return torch.cat([self.network(images.float() / 255) for images in split.images.split(256)])

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Count the network's right answers."""
        if self.network is not None:
            right = (self.network(batch.images_in_unit_range()).argmax(1) == batch.labels).float()
            self._validation.append(right)

    def on_validation_epoch_end(self) -> None:
        """Log ``val/accuracy`` of the network, or without one of the filters on the tuning images."""
        if self._validation:
            self.log("val/accuracy", torch.cat(self._validation).mean())
            self._validation = []
        elif len(self.filters) and len(self._data.split("tuning")):
            answers = self.answers(self._data.split("tuning"), self._data)
            right = answers[self.methods[0]] == self._data.split("tuning").labels.numpy()
            self.log("val/accuracy", float(right.mean()))

    def test_step(self, batch: Batch, batch_idx: int) -> None:
        """Nothing: methods look at all test images at once when the test ends."""

    def on_test_epoch_end(self) -> None:
        """Keep the answers as :attr:`result`; log ``test/accuracy/<method>``."""
        split = self._data.split("test")
        rows = torch.arange(0, len(split), self._data.test_every)
        shown = ImageBatches(split.images[rows], split.labels[rows])
        conditions = {name: found[rows.numpy()] for name, found in self._data.test_conditions().items()}
        self.result = RecognitionResult(shown.labels.numpy(), self.answers(shown, self._data), conditions)
        self.log_dict({f"test/accuracy/{method}": value for method, value in self.result.accuracy().items()})
        for name in conditions:
            accuracy = self.result.accuracy_under(name)
            self.log_dict({f"test/accuracy/{method}/{name}": value for method, value in accuracy.items()})

    def configure_optimizers(self) -> Any:
        """The optimiser of the network, with the schedule stepped once an epoch; none without one."""
        return None if self.network is None else optimizers(self, self.optimizer_factory, self.schedule)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the network learnt at all, by the rule of classification; filters are not judged."""
        if self.network is None:
            return True
        return classification_converged(validation["val/accuracy"], len(self._data.learnt))

    # -- what is kept --------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, np.ndarray]:
        """True classes, and answers by method."""
        assert self.result is not None
        answers = {f"answer/{method}": found for method, found in self.result.answers.items()}
        conditions = {f"condition/{name}": found for name, found in self.result.conditions.items()}
        return {"labels": self.result.labels, **answers, **conditions}

    def facts(self) -> dict[str, Any]:
        """How many filters and parts there are, and at which price each machine was fitted."""
        filters, parts = len(self.filters), len(self.filters.rho)
        prices = {name: float(machine["price"]) for name, machine in self.machines.items()}  # type: ignore[index]
        return {"filters": filters, "parts": parts, "prices": prices}

    def figures(self, data: ExampleData) -> "Iterator[tuple[str, Figure]]":
        """Pictures of the test; see :func:`~sextant.tasks.cosfire_report.recognition_figures`."""
        from sextant.tasks.cosfire_report import recognition_figures

        assert self.result is not None
        return recognition_figures(self, data)

    def configured_from(self) -> Prototypes:
        """What the filters were configured from."""
        kept = self.prototypes
        return Prototypes(kept["labels"], kept["images"], kept["points"], kept["own"])

    @property
    def _data(self) -> ExampleData:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]
