"""Places for training and test, and checks of their splits."""

import numpy as np
import pytorch_lightning as pl
from torch.utils.data import DataLoader

from sextant.chapters.places.data.augmentation import PlaceAugmentation
from sextant.chapters.places.data.batches import PlaceBatch, PlaceBatches, PlaceBatchImages
from sextant.chapters.places.data.images import PlaceImages, Split
from sextant.chapters.places.data.source import PlaceSource
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.data.batches import EpochBatches, epoch_of, loader
from sextant.data.share import Share
from sextant.errors import ArgumentError, problem_list

#: the class that the arguments belong to
PARENT = "PlaceDataModule"


def check_headings(images: PlaceImages, split: str, tolerance: PlaceTolerance, key: str) -> None:
    """Raise a ``UserError`` that names images without a heading if the tolerance takes headings into account.

    Args:
        images: of the split.
        split: its name.
        tolerance: of one place.
        key: the argument that gives the tolerance.
    """
    if tolerance.heading_deg is None:
        return
    unknown = np.arange(len(images)) if images.heading_deg is None else np.flatnonzero(np.isnan(images.heading_deg))
    if len(unknown):
        raise ArgumentError(
            f"{key}.{tolerance.unit}.heading_deg={tolerance.heading_deg:g}, but {len(unknown):,} of {len(images):,} "
            f"{split} images {'has' if len(unknown) == 1 else 'have'} no "
            f"heading\n{problem_list([images.names[row] for row in unknown])}",
            f"Give each a heading, or ignore headings: {key}.{tolerance.unit}.heading_deg=null",
            of=PARENT,
        )


def check_search(images: PlaceImages, split: str, tolerance: PlaceTolerance) -> None:
    """Raise a ``UserError`` unless images of one condition can be looked up in those of another.

    Queries without a positive are not an error as long as one has a positive: metrics count them.

    Args:
        images: of the split.
        split: its name.
        tolerance: within which images show the same place in validation and test.
    """
    key = "test_tolerance"
    check_headings(images, split, tolerance, key)
    reference, *queries = images.conditions
    if not queries:
        setting = "test_conditions" if split == "test" else "train_conditions"
        raise ArgumentError(
            f"the {split} split has one condition, {reference}: the first is the map, and others are looked up in it",
            f"Name at least two in the dataset (`{split}` or `conditions`), and in `{setting}` unless it is null.",
            of=PARENT,
        )
    rows = np.concatenate([images.rows_of(condition) for condition in queries])
    if not images.positives(rows, images.rows_of(reference), tolerance).nnz:
        raise ArgumentError(
            f"none of {len(rows):,} {split} images of {', '.join(queries)} has its place among the images of "
            f"{reference}, within {tolerance.name}",
            "Check the poses: both must be in the same frame, in metres. Or widen the tolerance: "
            f"{key}.{tolerance.unit}.positive=<more>",
            of=PARENT,
        )


def check_training(batches: PlaceBatches) -> None:
    """Raise a ``UserError`` if there are fewer training places than a batch needs."""
    there = len(batches.anchors)
    if batches.batch_places > there:
        raise ArgumentError(
            f"batch_places={batches.batch_places}, but the training split has {there:,} places with two or more images",
            f"batch_places={there} at most, or add images.",
            of=batches,
        )


STAGES: dict[str, tuple[Split, ...]] = {"fit": ("train", "val"), "validate": ("val",), "test": ("test",)}


class PlaceData(pl.LightningDataModule):
    """Batches of places for training; all images in order for validation and test.

    Args:
        source: of the images.
        tolerance: within which images show the same place in training.
        test_tolerance: the same for validation and test; None for that of training.
        batch_places: places in a training batch.
        batch_conditions: images of each place.
        eval_batch_size: images in a validation or test batch.
        seed: of the training batches and their augmentation.
        workers: processes that read training batches; 0 reads them in the training process.
        augmentation: changes training images; None leaves them as they are.
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
    ):
        super().__init__()
        self.source, self.tolerance = source, tolerance
        self.test_tolerance = test_tolerance or tolerance
        self.batch_places, self.batch_conditions = batch_places, batch_conditions
        self.eval_batch_size, self.seed, self.workers = eval_batch_size, seed, workers
        self.augmentation = augmentation
        self._splits: dict[str, PlaceImages] = {}
        self._batches: PlaceBatches | None = None

    def setup(self, stage: str) -> None:
        """Read the splits that ``stage`` needs: training and validation for ``fit``, test for ``test``.

        Raises:
            UserError: a split cannot be read or searched; the message names the key or file at fault.
        """
        for split in STAGES.get(stage, ()):
            self.read(split)

    def read(self, split: Split) -> None:
        """Read a split unless it has been read.

        Raises:
            MissingDataError: there is no such split.
            UserError: it cannot be read or searched; the message names the key or file at fault.
        """
        if split not in self._splits:
            images = self.source.read(split)
            if split != "train":
                check_search(images, split, self.test_tolerance)
            self._splits[split] = images

    def check(self) -> None:
        """Read all splits, so that problems with any of them are reported before training starts.

        Raises:
            UserError: as :meth:`setup`, or the training split has no places, or fewer than a batch needs.
        """
        self.read("train")
        check_training(self._training_batches())
        self.setup("fit")
        self.setup("test")

    def _training_batches(self) -> PlaceBatches:
        if self._batches is None:
            places = self._splits["train"]
            check_headings(places, "train", self.tolerance, "tolerance")
            self._batches = PlaceBatches(places, self.tolerance, self.batch_places, self.batch_conditions, self.seed)
        return self._batches

    @property
    def splits(self) -> dict[str, PlaceImages]:
        """The images of all splits that were read."""
        return dict(self._splits)

    def split(self, name: str) -> PlaceImages:
        """The images of ``train``, ``val`` or ``test``, once :meth:`setup` has read them."""
        return self._splits[name]

    def train_dataloader(self) -> DataLoader[PlaceBatch]:
        """New batches of places in every epoch, a function of (seed, epoch)."""
        places, batches, trainer = self._splits["train"], self._training_batches(), self.trainer
        batches.set_epoch(epoch_of(trainer))
        images = PlaceBatchImages(places, self.augmentation, self.seed, Share.of_trainer(trainer))
        return loader(images, batches, self.workers)

    def val_dataloader(self) -> DataLoader[PlaceBatch]:
        """Validation images in order."""
        return self.in_order("val")

    def test_dataloader(self) -> DataLoader[PlaceBatch]:
        """Test images in order."""
        return self.in_order("test")

    def in_order(self, name: str) -> DataLoader[PlaceBatch]:
        """All images of a split in order, unchanged; for training images, used in fitting and mining."""
        places = self._splits[name]
        return loader(PlaceBatchImages(places), EpochBatches(len(places), self.eval_batch_size))
