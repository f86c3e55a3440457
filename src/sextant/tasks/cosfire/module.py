"""Recognition by filters configured from single examples (chapter 6), and the methods they are compared with."""

import copy
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytorch_lightning as pl
import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.baselines.grey import LUMA
from sextant.baselines.linear_svm import SCALINGS, LinearSVM
from sextant.data.batches import Batch, ImageBatches
from sextant.data.examples import ExampleData
from sextant.errors import UserError
from sextant.evaluation import classification_converged
from sextant.layers.cosfire import Cosfire, DoGBank, GaborBank
from sextant.models import FeatureMap
from sextant.tasks.cosfire.comparison import Comparison
from sextant.tasks.cosfire.filter_prototypes import Prototypes, PrototypeSettings, configure, own_responses
from sextant.tasks.cosfire.fine_tuning import LinearLayer, TunedLayer, fine_tune, log_maxima, tune_layer
from sextant.tasks.cosfire.learnt_later import LearntLater
from sextant.tasks.cosfire.methods import (
    NEAREST_AMONG,
    OF_EXAMPLES,
    OF_MAXIMA,
    OF_NETWORK,
    REPRESENTATIONS,
    SVMS,
    TUNED,
    Method,
    Representation,
    nearest_example,
    strongest_filter,
    svm_of,
)
from sextant.tasks.cosfire.representations import Progress, feature_maps, filter_maxima
from sextant.tasks.cosfire.result import RecognitionResult
from sextant.tasks.optimizing import OptimizerFactory, Schedule, nothing_to_optimize, optimizers
from sextant.tasks.step_losses import StepLosses

if TYPE_CHECKING:
    pass


class CosfireRecognition(pl.LightningModule):
    """Trains a network, if there is one to train; then configures filters and fits SVMs to the examples.

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
        self._make_filters = partial(filters, features)
        self.filters = self._make_filters()
        self.tuned = self._make_filters() if comparison.fine_tuning.epochs else None
        self.prototype_settings, self.comparison = prototypes, comparison
        self.describe, self.seed, self.show = describe, seed, show
        self.optimizer_factory, self.schedule = optimizer, schedule
        self.step_losses = StepLosses(log_every)
        self.prototypes = LearntLater("labels", "images", "points", "own", "pictures", "least_maxima", "least_tiled")
        self.known = LearntLater("images", "labels")
        tuned = TUNED if self.tuned is not None else ()
        self.tuned_layers = nn.ModuleDict({name: LearntLater("weights", "bias", "losses") for name in tuned})
        self.machines = nn.ModuleDict(
            {name: LearntLater("weights", "bias", "price", "scaling") for name in SVMS if name in self.methods}
        )
        self.result: RecognitionResult | None = None
        self._validation: list[Tensor] = []

    @property
    def methods(self) -> list[Method]:
        """Those of the comparison that there are the parts for; the first is the one that predicts."""
        missing: set[Method] = set() if self.features is not None else set(OF_NETWORK)
        missing |= {"network"} if self.network is None or not self.comparison.network_answers else set()
        missing |= {"descriptor"} if self.describe is None else set()
        found = [method for method in self.comparison.methods if method not in missing]
        return [*found, *TUNED] if self.comparison.fine_tuning.epochs else found

    # -- the network ---------------------------------------------------------------------------------------------------

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor | None:
        """Cross-entropy of the network; nothing without one to train."""
        if self.network is None:
            self.optimizers().step()  # type: ignore[union-attr]
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
        """Configure filters from the examples, and fit the SVMs to them.

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
        seen = self.seen(examples.images)
        try:
            found = configure(self.filters, seen, examples.labels, self.prototype_settings, generator)
        except UserError as error:
            raise self._network_to_blame(error) from None
        self.prototypes.keep(
            labels=found.labels,
            images=found.images,
            points=found.points,
            pictures=seen[found.images],
        )
        if any(method in self.methods for method in OF_EXAMPLES):
            order = torch.randperm(len(examples), generator=torch.Generator().manual_seed(self.seed))
            rows = order[:NEAREST_AMONG].sort().values
            self.known.keep(images=examples.images[rows], labels=examples.labels[rows])
        of_examples: dict[str, Tensor] = {}
        of_tuning: dict[str, Tensor] = {}
        for kind in [REPRESENTATIONS[method] for method in OF_MAXIMA if method in self.machines]:
            maxima = self._seen_as(kind, examples.images, of_examples)
            positive = maxima[maxima > 0]
            least = positive.min().reshape(1) if len(positive) else torch.ones(1)
            self.prototypes.keep(**{f"least_{kind}": least})
        self.prototypes.keep(own=self._own_responses(found, seen, of_examples))
        choosing = bool(len(tuning)) and len(self.comparison.c_values) * len(self.comparison.scalings) > 1
        for name, machine in self.machines.items():
            known = self._features_of(name, examples.images, of_examples)  # type: ignore[arg-type]
            held = self._features_of(name, tuning.images, of_tuning) if choosing else known[:0]  # type: ignore[arg-type]
            logarithmic = self.comparison.logarithms and name in OF_MAXIMA
            fitted = self._fit_svm((known, examples.labels), (held, tuning.labels), logarithmic=logarithmic)
            machine.keep(  # type: ignore[operator]
                weights=torch.from_numpy(fitted.weights),
                bias=torch.from_numpy(fitted.bias),
                price=torch.tensor([fitted.c], dtype=torch.float64),
                scaling=torch.tensor([SCALINGS.index(fitted.scaling)]),
            )
        if self.tuned is not None:
            maxima = self._seen_as("maxima", examples.images, of_examples)
            held = self._seen_as("maxima", tuning.images, of_tuning) if choosing else maxima[:0]
            self._fine_tune(examples, maxima, (held, tuning.labels))

    def _network_to_blame(self, error: UserError) -> UserError:
        """The same error; of a network that has learnt little, whose maps may be to blame, one that says so."""
        accuracy = self.trainer.callback_metrics.get("val/accuracy")
        if self.network is None or accuracy is None or self.converged({"val/accuracy": float(accuracy)}):
            return error
        return UserError(
            f"{error.problem}; the network has learnt little, its validation accuracy is {100 * float(accuracy):.0f} %",
            f"Train it longer or differently: trainer.max_epochs, optimizer.lr, optimizer. {error.fix}",
        )

    def _own_responses(
        self, found: Prototypes, seen: UInt8[Tensor, "n c h w"], known: dict[str, Tensor]
    ) -> Float[Tensor, "f"]:
        """The strongest response of each filter to its own prototype, from the maxima of all examples if known."""
        if "maxima" in known or "tiled" in known:
            maxima = self._seen_as("maxima", seen, known)
            return maxima[found.images, torch.arange(len(self.filters))]
        return own_responses(self.filters, seen[found.images])

    def _fit_svm(
        self, examples: tuple[Tensor, Tensor], tuning: tuple[Tensor, Tensor], *, logarithmic: bool
    ) -> LinearSVM:
        """Logarithms have no length that would mean something: of them ``unit`` is no scaling."""
        chosen = self.comparison
        scalings = tuple(scaling for scaling in chosen.scalings if not (logarithmic and scaling == "unit")) or ("all",)
        return svm_of(examples, tuning, len(self.classes), chosen.c_values, scalings, chosen.choose_among, self.seed)

    def _fitted(self, method: Method) -> LinearSVM:
        kept = self.machines[method]
        weights, bias, price, scaling = (kept[name].cpu().numpy() for name in ("weights", "bias", "price", "scaling"))  # type: ignore[index]
        return LinearSVM(weights, bias, float(price[0]), SCALINGS[int(scaling[0])])

    def _fine_tune(self, examples: ImageBatches, maxima: Tensor, held: tuple[Tensor, Tensor]) -> None:
        """Fine-tune a copy of the filters, starting from the SVM of their log-maxima; as a control that SVM alone."""
        assert self.tuned is not None
        seen = (log_maxima(maxima), examples.labels), (log_maxima(held[0]), held[1])
        svm = self._fit_svm(*seen, logarithmic=True)
        start = LinearLayer(torch.from_numpy(svm.weights), torch.from_numpy(svm.bias))
        settings = self.comparison.fine_tuning

        def order() -> torch.Generator:
            return torch.Generator().manual_seed(self.seed)

        alone = tune_layer(start, maxima, examples.labels, settings, order())
        with self.show("fine-tuning") as progress:
            found = fine_tune(
                self.filters,
                self._make_filters,
                start,
                maxima,
                self.seen(examples.images),
                examples.labels,
                settings,
                order(),
                progress,
            )
        self.tuned.load_state_dict(found.filters.state_dict())
        tuned: dict[Method, TunedLayer] = {"cosfire_tuned": found, "layer_tuned": alone}
        for name, made in tuned.items():
            losses = torch.tensor(made.losses, dtype=torch.float64)
            self.tuned_layers[name].keep(weights=made.layer.weights, bias=made.layer.bias, losses=losses)  # type: ignore[operator]

    def _network_state(self) -> dict[str, Tensor]:
        assert self.network is not None
        return {f"network.{name}": value for name, value in self.network.state_dict().items()}

    def _features_of(
        self, method: Method, images: UInt8[Tensor, "n c h w"], known: dict[str, Tensor]
    ) -> Float[Tensor, "n d"]:
        """What a method sees of images."""
        kind = REPRESENTATIONS[method]
        seen = self._seen_as(kind, images, known)
        if method in OF_MAXIMA and self.comparison.logarithms:
            return seen.clamp(min=float(self.prototypes[f"least_{kind}"])).log()
        return seen

    def _seen_as(self, kind: Representation, images: UInt8[Tensor, "n c h w"], known: dict[str, Tensor]) -> Tensor:
        """What several methods see is computed once and kept in ``known``."""
        if kind not in known and kind == "maxima":
            tiled = self._seen_as("tiled", images, known)
            known[kind] = tiled.unflatten(1, (len(self.filters), -1)).amax(2)
        elif kind not in known:
            known[kind] = self._represented(kind, images)
        return known[kind]

    def seen(self, images: UInt8[Tensor, "n c h w"]) -> UInt8[Tensor, "n k h w"]:
        """Images as the filters take them: in grey (luma) where they look at images themselves."""
        if images.shape[1] == 1 or not isinstance(self.filters.bank, (GaborBank, DoGBank)):
            return images
        luma = torch.from_numpy(LUMA)[:, None, None]
        return torch.cat([(batch * luma).sum(1, keepdim=True).round().byte() for batch in images.split(256)])

    def _represented(self, kind: Representation, images: Tensor) -> Tensor:
        if kind in ("tiled", "tuned"):
            filters = self.filters if kind == "tiled" else self.tuned
            assert filters is not None
            tiles = self.comparison.tiles if kind == "tiled" and "tiled_svm" in self.methods else 1
            with self.show("filtering") as progress:
                return filter_maxima(filters, self.seen(images), progress, tiles=tiles)
        if kind == "descriptor":
            assert self.describe is not None
            return torch.from_numpy(self.describe(images.permute(0, 2, 3, 1).contiguous().numpy()))
        if kind == "logits":
            return self._logits(images)
        assert self.features is not None
        return feature_maps(self.features, images, "pooled" if kind == "pooled" else "full")

    # -- validation and test -------------------------------------------------------------------------------------------

    def scores(self, images: UInt8[Tensor, "n c h w"], methods: Sequence[Method] | None = None) -> dict[Method, Tensor]:
        """How much each image looks like each class, (n, k), by method; on the processor, -inf for no class at all.

        Args:
            images: bytes, on the processor.
            methods: of :attr:`methods`; None is all.
        """
        known: dict[str, Tensor] = {}
        of_examples: dict[str, Tensor] = {}
        found: dict[Method, Tensor] = {}
        for method in self.methods if methods is None else methods:
            features = self._features_of(method, images, known)
            if method in self.machines:
                found[method] = torch.from_numpy(self._fitted(method).scores(features.double().numpy()))
            elif method in TUNED:
                kept = self.tuned_layers[method]
                layer = LinearLayer(kept["weights"], kept["bias"])  # type: ignore[index]
                found[method] = layer.scores(log_maxima(features))
            elif method == "strongest_filter":
                own, labels = self.prototypes["own"].cpu(), self.prototypes["labels"].cpu()
                found[method] = strongest_filter(features, own, labels, len(self.classes))
            elif method in OF_EXAMPLES:
                among = self._features_of(method, self.known["images"].cpu(), of_examples)
                found[method] = nearest_example(features, among, self.known["labels"].cpu(), len(self.classes))
            else:
                found[method] = features
        return found

    def answers(self, images: UInt8[Tensor, "n c h w"]) -> dict[Method, np.ndarray]:
        """The class that each method gives each image."""
        return {method: scores.argmax(1).numpy() for method, scores in self.scores(images).items()}

    def _logits(self, images: Tensor) -> Tensor:
        assert self.network is not None
        with torch.no_grad():
            batches = (batch.to(self.device).float() / 255 for batch in images.split(256))
            return torch.cat([self.network(batch).cpu() for batch in batches])

    def predict_step(self, images: UInt8[Tensor, "n c h w"]) -> Float[Tensor, "n k"]:
        """How much images, bytes, look like each class to the first method."""
        method = self.methods[0]
        return self.scores(images, [method])[method]

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
            tuning, method = self._data.split("tuning"), self.methods[0]
            answers = self.scores(tuning.images, [method])[method].argmax(1)
            self.log("val/accuracy", (answers == tuning.labels).float().mean())

    def test_step(self, batch: Batch, batch_idx: int) -> None:
        """Nothing: methods look at all test images at once when the test ends."""

    def on_test_epoch_end(self) -> None:
        """Keep the answers as :attr:`result`; log ``test/accuracy/<method>``."""
        split = self._data.split("test")
        rows = torch.arange(0, len(split), self._data.test_every)
        shown = ImageBatches(split.images[rows], split.labels[rows])
        conditions = {name: found[rows.numpy()] for name, found in self._data.test_conditions().items()}
        self.result = RecognitionResult(shown.labels.numpy(), self.answers(shown.images), conditions)
        self.log_dict({f"test/accuracy/{method}": value for method, value in self.result.accuracy().items()})
        for name in conditions:
            accuracy = self.result.accuracy_under(name)
            self.log_dict({f"test/accuracy/{method}/{name}": value for method, value in accuracy.items()})

    def configure_optimizers(self) -> Any:
        """The optimiser of the network, with the schedule stepped once an epoch."""
        if self.network is None:
            return nothing_to_optimize()
        return optimizers(self, self.optimizer_factory, self.schedule)

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
        """How many filters, parts and weights there are, and how each SVM was fitted.

        Weights are those of the network; of its feature map, a copy, if that is another run's.
        """
        filters, parts = len(self.filters), len(self.filters.rho)
        weighing = self.features if self.network is None else self.network
        weights = 0 if weighing is None else sum(weight.numel() for weight in weighing.parameters())
        machines = {name: self._fitted(name) for name in self.machines}  # type: ignore[arg-type]
        prices = {name: machine.c for name, machine in machines.items()}
        scalings = {name: machine.scaling for name, machine in machines.items()}
        found = {"filters": filters, "parts": parts, "parameters": weights, "prices": prices, "scalings": scalings}
        losses = {name: layer["losses"].tolist() for name, layer in self.tuned_layers.items()}  # type: ignore[index]
        return found | ({"tuning_losses": losses} if losses else {})

    def configured_from(self) -> Prototypes:
        """What the filters were configured from."""
        kept = self.prototypes
        return Prototypes(*(kept[name].cpu() for name in ("labels", "images", "points")))

    @property
    def _data(self) -> ExampleData:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]
