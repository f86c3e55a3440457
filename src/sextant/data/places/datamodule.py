"""Training, validation and test images of a source of places."""

import pytorch_lightning as pl
from torch import Tensor
from torch.utils.data import DataLoader, Sampler

from sextant.data.batches import EpochBatches
from sextant.data.places.augmentation import PlaceAugmentation
from sextant.data.places.batches import PlaceBatch, PlaceBatches, PlaceBatchImages
from sextant.data.places.images import PlaceImages
from sextant.data.places.source import PlaceSource
from sextant.data.places.tolerance import PlaceTolerance


class PlaceData(pl.LightningDataModule):
    """Batches of places for training; all images in order for validation and test.

    Args:
        source: of the images.
        tolerance: of one place in training.
        test_tolerance: of one place in validation and test; None for that of training.
        batch_places: places in a training batch.
        batch_conditions: images of each of them.
        eval_batch_size: images in a validation or test batch.
        seed: of the training batches and their augmentation.
        workers: processes that read training batches; 0 reads them in the training process.
        augmentation: changes training images; None leaves them as they are.
        jitter: show places from anywhere within the tolerance, not from the nearest frame.
    """

    def __init__(
        self,
        source: PlaceSource,
        tolerance: PlaceTolerance,
        test_tolerance: PlaceTolerance | None = None,
        *,
        batch_places: int,
        batch_conditions: int,
        eval_batch_size: int,
        seed: int,
        workers: int = 0,
        augmentation: PlaceAugmentation | None = None,
        jitter: bool = True,
    ):
        super().__init__()
        self.source, self.tolerance = source, tolerance
        self.test_tolerance = test_tolerance or tolerance
        self.batch_places, self.batch_conditions = batch_places, batch_conditions
        self.eval_batch_size, self.seed, self.workers = eval_batch_size, seed, workers
        self.augmentation, self.jitter = augmentation, jitter
        self._splits: dict[str, PlaceImages] = {}

    def setup(self, stage: str) -> None:
        """Read the splits that ``stage`` needs: training and validation for ``fit``, test for ``test``."""
        for split in {"fit": ("train", "val"), "validate": ("val",), "test": ("test",)}.get(stage, ()):
            if split not in self._splits:
                self._splits[split] = self.source.read(split)  # type: ignore[arg-type]

    def split(self, name: str) -> PlaceImages:
        """The images of ``train``, ``val`` or ``test``, once they were read by :meth:`setup`."""
        return self._splits[name]

    def train_dataloader(self) -> DataLoader[PlaceBatch]:
        """Places anew in every epoch, a function of (seed, epoch)."""
        places, trainer = self._splits["train"], self.trainer
        rank = (0, 1) if trainer is None else (trainer.global_rank, trainer.world_size)
        batches = PlaceBatches(
            places, self.tolerance, self.batch_places, self.batch_conditions, self.seed, *rank, jitter=self.jitter
        )
        if trainer is not None:
            # On resuming, Lightning takes the first iterator before it tells the sampler which epoch it is.
            batches.set_epoch(trainer.fit_loop.epoch_progress.current.processed)  # type: ignore[attr-defined]
        return self._loader(PlaceBatchImages(places, self.augmentation, self.seed), batches, self.workers)

    def val_dataloader(self) -> DataLoader[PlaceBatch]:
        """Validation images in order."""
        return self.in_order("val")

    def test_dataloader(self) -> DataLoader[PlaceBatch]:
        """Test images in order."""
        return self.in_order("test")

    def in_order(self, name: str) -> DataLoader[PlaceBatch]:
        """All images of a split in order, unchanged; of training for what is fitted to it or mined from it."""
        places = self._splits[name]
        return self._loader(PlaceBatchImages(places), EpochBatches(len(places), self.eval_batch_size), 0)

    @staticmethod
    def _loader(images: PlaceBatchImages, batches: Sampler[Tensor], workers: int) -> DataLoader[PlaceBatch]:
        return DataLoader(images, sampler=batches, batch_size=None, num_workers=workers, persistent_workers=workers > 0)
