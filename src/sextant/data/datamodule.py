"""Training, validation and test batches of a labelled image source."""

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Int64
from numpy import ndarray
from torch.utils.data import DataLoader

from sextant.data.augmentation import Augmentation, AugmentedBatches, NoAugmentation
from sextant.data.batches import Batch, EpochBatches, ImageBatches, epoch_of, loader
from sextant.data.share import Share, SharedBatches
from sextant.data.source import ImageSource, LabelledImages
from sextant.errors import UserError


def stratified_split(
    labels: Int64[ndarray, "n"], fraction: float, seed: int
) -> tuple[Int64[ndarray, "t"], Int64[ndarray, "v"]]:
    """Indices of training and validation images, with the same share of every class in each.

    Args:
        labels: class of every image.
        fraction: share of validation images, in (0, 1); at least one image of each class is held out.
        seed: of the choice.

    Raises:
        ValueError: a class has a single image.
    """
    rng = np.random.default_rng(seed)
    train, validation = [], []
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        held_out = max(1, round(fraction * len(members)))
        if held_out >= len(members):
            raise ValueError(f"class {label} has {len(members)} training images, too few to hold out {held_out}")
        validation.append(members[:held_out])
        train.append(members[held_out:])
    return np.sort(np.concatenate(train)), np.sort(np.concatenate(validation))


class ImageData(pl.LightningDataModule):
    """Holds a source in memory and serves whole batches of it.

    Args:
        source: where the images come from.
        batch_size: images in a training batch.
        eval_batch_size: images in a validation or test batch.
        validation_fraction: share of the training split that is held out for validation.
        split_seed: of that choice, separate from the run's seed: every run of a sweep has the same three splits.
        seed: of the order of the training images, and of their augmentation.
        augmentation: changes training images; None leaves them unchanged.
        test_every: test only every k-th image, starting with the first.
        workers: processes that fetch batches; 0 fetches in the training process, the fastest for images in memory.
    """

    def __init__(
        self,
        source: ImageSource,
        *,
        batch_size: int,
        eval_batch_size: int,
        validation_fraction: float,
        split_seed: int,
        seed: int,
        augmentation: Augmentation | None = None,
        test_every: int = 1,
        workers: int = 0,
    ):
        super().__init__()
        self.source = source
        self.batch_size, self.eval_batch_size = batch_size, eval_batch_size
        self.validation_fraction, self.split_seed = validation_fraction, split_seed
        self.seed, self.workers = seed, workers
        self.test_every = test_every
        self.augmentation = augmentation or NoAugmentation()
        self._splits: dict[str, ImageBatches] = {}

    def setup(self, stage: str) -> None:
        """Read the splits that ``stage`` needs: training and validation for ``fit``, test for ``test``."""
        if stage == "fit" and "train" not in self._splits:
            data = self.source.read("train")
            try:
                train, validation = stratified_split(data.labels, self.validation_fraction, self.split_seed)
            except ValueError as error:
                raise UserError(
                    f"dataset={self.source.name}: no validation split can be made: {error}", "Add images to that class."
                ) from None
            self._splits["train"] = in_memory(LabelledImages(data.images[train], data.labels[train]))
            self._splits["validation"] = in_memory(LabelledImages(data.images[validation], data.labels[validation]))
        if stage == "test" and "test" not in self._splits:
            self._splits["test"] = in_memory(self.source.read("test"))

    def split(self, name: str) -> ImageBatches:
        """The images of ``train``, ``validation`` or ``test``, once :meth:`setup` has read them."""
        return self._splits[name]

    def train_dataloader(self) -> DataLoader[Batch]:
        """Shuffled batches, the order a function of (seed, epoch)."""
        images, trainer = AugmentedBatches(self._splits["train"], self.augmentation, self.seed), self.trainer
        batches = EpochBatches(len(images), self.batch_size, self.seed, numbered=True)
        batches.set_epoch(epoch_of(trainer))
        return loader(SharedBatches(images, Share.of_trainer(trainer)), batches, self.workers)

    def val_dataloader(self) -> DataLoader[Batch]:
        """Validation batches in order."""
        images = self._splits["validation"]
        return loader(images, EpochBatches(len(images), self.eval_batch_size), self.workers)

    def test_dataloader(self) -> DataLoader[Batch]:
        """Batches of every ``test_every``-th test image, in order."""
        images = self._splits["test"]
        batches = EpochBatches(len(images), self.eval_batch_size, every=self.test_every)
        return loader(images, batches, self.workers)


def in_memory(data: LabelledImages) -> ImageBatches:
    """Images in memory, from which batches can be taken."""
    return ImageBatches(torch.from_numpy(data.images), torch.from_numpy(data.labels))
