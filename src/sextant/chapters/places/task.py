"""Place recognition: a compact descriptor that is similar for images of one place under any appearance (chapter 3)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Float32
from numpy import ndarray
from torch import Tensor
from torch.nn.utils import clip_grad_norm_
from torch.optim import Optimizer

from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.data.batches import PlaceBatch, PlaceBatchImages, batch_places, places_of
from sextant.chapters.places.data.datamodule import PlaceData
from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.chapters.places.whitening import Whitening, solve_projection
from sextant.data.share import Share
from sextant.evaluation.positives import Positives
from sextant.evaluation.protocols import places_converged
from sextant.evaluation.retrieval import chance_recall, recall
from sextant.losses import PlaceLoss
from sextant.losses.place_losses import Pairing
from sextant.models.place_net import PlaceNet
from sextant.retrieval import CachedHardMining, Mining, NoMining, gathered, relations
from sextant.retrieval.nearest import nearest_neighbours
from sextant.training.schedules import OptimizerFactory, Schedule, log_training_loss, optimizers
from sextant.training.steps import StepLosses, over_processes

#: number of training images from which a pooling is initialised
FIRST_LOOK = 256


@dataclass(frozen=True)
class PlaceResult:
    """Descriptors of all images of the test split, in its order, and their places."""

    descriptors: Float32[ndarray, "n d"]
    places: PlaceImages


class PlaceRecognition(pl.LightningModule):
    """Trains a network so that descriptors of the same place are similar and those of different places are not.

    Args:
        network: computes the descriptors.
        spec: of its images.
        loss: of the descriptors of a batch.
        mining: chooses triplets for the loss; ``NoMining`` passes it all pairs of the batch.
        seed: of random draws in mining.
        optimizer: builds the optimiser from the parameters; None for a model used only for inference.
        schedule: factor on the learning rate as a function of the share of epochs done.
        clip: largest gradient norm.
        whitening: replaces the last layer after the last epoch by its closed-form solution; None keeps the trained one.
        log_every: steps between two logged training losses.
    """

    monitor, monitor_mode = "val/recall_at_1", "max"

    def __init__(
        self,
        network: PlaceNet,
        spec: ImageSize,
        loss: PlaceLoss,
        mining: Mining | CachedHardMining,
        *,
        seed: int = 0,
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        clip: float = 1.0,
        whitening: Whitening | None = None,
        log_every: int = 50,
    ):
        super().__init__()
        self.network, self.spec = network, spec
        self.loss, self.mining, self.seed = loss, mining, seed
        self.optimizer_factory, self.schedule, self.clip = optimizer, schedule, clip
        self.whitening = whitening
        self.step_losses = StepLosses(log_every)
        self.result: PlaceResult | None = None
        self._mined: Tensor = torch.zeros(0, 3, dtype=torch.int64)
        self._seen: list[Tensor] = []

    def forward(self, images: Tensor) -> Tensor:
        """Descriptors ``(b, d)`` of images in [0, 1], ``(b, c, h, w)``."""
        return self.network(images)  # type: ignore[no-any-return]

    def on_fit_start(self) -> None:
        """Initialise a pooling that starts from features, unless training is resumed."""
        if self.trainer.global_step == 0:
            train = self._data.split("train")
            generator = torch.Generator().manual_seed(self.seed)
            chosen = torch.randperm(len(train), generator=generator)[:FIRST_LOOK].numpy()
            images = torch.from_numpy(train.images[chosen]).permute(0, 3, 1, 2).float() / 255
            self.network.initialise_pooling(images.to(self.device), generator)

    def training_step(self, batch: PlaceBatch, batch_idx: int) -> Tensor:
        """The loss of a batch of places, or of triplets from the whole training set if mining is cached."""
        epoch = self.seed * 1_000_003 + self.trainer.current_epoch
        generator = torch.Generator().manual_seed(epoch * 100_003 + batch_idx)
        mining, tolerance, pairing = self.mining, self._data.tolerance, None
        if isinstance(mining, CachedHardMining):
            batch, pairing = self._next_triplets(mining, len(batch.rows), batch_idx, generator)
        descriptors = over_processes(self(batch.images_in_unit_range()), len(batch.rows), self._share)
        if not isinstance(mining, CachedHardMining):
            relation = relations(batch_places(batch, tolerance), tolerance)
            pairing = relation if isinstance(mining, NoMining) else mining(descriptors, relation, generator).triplets
        value, active = self.loss(descriptors, pairing)
        log_training_loss(self, self.step_losses.add(self.global_step, value), active=float(active))
        return value  # type: ignore[no-any-return]

    def _next_triplets(
        self, mining: CachedHardMining, images: int, batch_idx: int, generator: torch.Generator
    ) -> tuple[PlaceBatch, Pairing]:
        """Images of the next ``images // 3`` triplets of the training set; mined again when due."""
        train, tolerance = self._data.split("train"), self._data.tolerance
        if batch_idx % mining.refresh == 0 or len(self._mined) == 0:
            cache = self._describe_training()
            mined = mining(cache, places_of(train, tolerance), tolerance, generator)
            self._mined = mined.triplets[torch.randperm(len(mined.triplets), generator=generator)]
        count = max(1, images // 3)
        chosen, self._mined = self._mined[:count], self._mined[count:]
        rows, triplets = gathered(chosen)
        numbers = rows + self.trainer.current_epoch * len(train)
        images_of = PlaceBatchImages(train, self._data.augmentation, self.seed, self._share)
        return images_of[numbers].to(self.device), triplets.to(self.device)

    @torch.no_grad()
    def _describe_training(self) -> Tensor:
        self.network.eval()
        batches = self._data.in_order("train")
        cache = torch.cat([self(batch.to(self.device).images_in_unit_range()).cpu() for batch in batches])
        self.network.train()
        return cache

    def on_train_epoch_start(self) -> None:
        """Mine anew in every epoch, so that a resumed epoch starts like an uninterrupted one."""
        self._mined = self._mined[:0]

    def on_train_epoch_end(self) -> None:
        """Check and log the losses of the last steps, so that no epoch ends unchecked; whiten after the last epoch."""
        log_training_loss(self, self.step_losses.flush())
        last = self.trainer.should_stop or self.trainer.current_epoch + 1 == self.trainer.max_epochs
        if self.whitening is not None and last:
            solve_projection(self.network, self._data.split("train"), self._data.tolerance, self.whitening)

    def configure_gradient_clipping(
        self, optimizer: Optimizer, gradient_clip_val: Any = None, gradient_clip_algorithm: Any = None
    ) -> None:
        """Clip the gradient norm to ``clip``."""
        clip_grad_norm_(self.network.parameters(), self.clip)

    def validation_step(self, batch: PlaceBatch, batch_idx: int) -> None:
        """Describe a batch."""
        self._seen.append(self(batch.images_in_unit_range()).float().cpu())

    def on_validation_epoch_end(self) -> None:
        """Log ``val/recall_at_1``, the mean over the traverses other than the map, and the chance level."""
        recall_at_1, chance = mean_recall(self._take(), self._data.split("val"), self._data.test_tolerance)
        self.log_dict({"val/recall_at_1": recall_at_1, "val/chance": chance})

    def test_step(self, batch: PlaceBatch, batch_idx: int) -> None:
        """Describe a batch."""
        self._seen.append(self(batch.images_in_unit_range()).float().cpu())

    def on_test_epoch_end(self) -> None:
        """Keep the descriptors as :attr:`result`; log the mean recall over the traverses other than the map."""
        self.result = PlaceResult(self._take(), self._data.split("test"))
        recall_at_1, chance = mean_recall(self.result.descriptors, self.result.places, self._data.test_tolerance)
        self.log_dict({"test/recall_at_1": recall_at_1, "test/chance": chance})

    def configure_optimizers(self) -> Any:
        """The optimiser, with the schedule stepped once per epoch."""
        return optimizers(self, self.optimizer_factory, self.schedule)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the run converged, by the rule in ``evaluation.protocols`` on the validation split."""
        return places_converged(validation["val/recall_at_1"], validation["val/chance"])

    def _take(self) -> Float32[ndarray, "n d"]:
        found, self._seen = torch.cat(self._seen).numpy(), []
        return np.ascontiguousarray(found, np.float32)

    @property
    def _share(self) -> Share:
        return Share.of_trainer(self.trainer)

    @property
    def _data(self) -> PlaceData:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]


def mean_recall(
    descriptors: Float32[ndarray, "n d"], places: PlaceImages, tolerance: PlaceTolerance
) -> tuple[float, float]:
    """Recall@1 averaged over the other traverses, with the first as the map, and that of a random ranking.

    Traverses that are copies of others, such as corrupted ones, are excluded; they are reported under their own names.
    """
    reference = places.rows_of(places.conditions[0])
    found = []
    for condition in places.originals[1:]:
        query = places.rows_of(condition)
        positives = Positives.from_sparse(places.positives(query, reference, tolerance))
        neighbours = nearest_neighbours(descriptors[reference], descriptors[query])
        found.append((recall(neighbours, positives, (1,)).over_all[1], chance_recall(positives)))
    first, second = np.mean(found, axis=0)
    return float(first), float(second)
