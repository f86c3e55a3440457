"""Training, validation and test crops of a source of panoramas."""

import numpy as np
import pytorch_lightning as pl
from torch.utils.data import DataLoader

from sextant.chapters.calibration.data.batches import CropBatch, Crops
from sextant.chapters.calibration.data.camera_distributions import CameraDistribution
from sextant.chapters.calibration.data.panoramas import PanoramaSource
from sextant.data.batches import EpochBatches, epoch_of, loader
from sextant.data.share import Share, SharedBatches
from sextant.geometry import CameraParameters

#: seeds of the draws of validation and test: the same for every run
VALIDATION, TEST = 1_000_001, 1_000_002


class CalibrationData(pl.LightningDataModule):
    """Crops cut on the fly from panoramas.

    Args:
        source: source of panoramas.
        distribution: distribution of cameras in training and validation.
        test_distribution: distribution of cameras in the test; None for the same.
        size: height and width of a crop in pixels.
        crops_per_panorama: by split; those of training are drawn again every epoch.
        batch_size: crops in a training batch.
        eval_batch_size: crops in a validation or test batch.
        seed: seed of the training draws and their order.
        workers: processes that cut crops; 0 cuts them in the training process.
        augment: vary lighting and sensor noise of training crops, and mirror them.
        canvas: crops are squares with pictures of any aspect in the middle.
        detail: smallest and largest number of lines of detail in training crops, drawn independently of their cameras.
        geometric_height: height of the crops for geometric methods; with that of ``size`` they get the same
            pixels, if crops have its aspect.
    """

    def __init__(
        self,
        source: PanoramaSource,
        distribution: CameraDistribution,
        test_distribution: CameraDistribution | None,
        *,
        size: tuple[int, int],
        crops_per_panorama: dict[str, int],
        batch_size: int,
        eval_batch_size: int,
        seed: int,
        workers: int = 0,
        augment: bool = False,
        canvas: bool = False,
        detail: tuple[float, float] | None = None,
        geometric_height: int = 256,
    ):
        super().__init__()
        self.source, self.distribution = source, distribution
        self.test_distribution = test_distribution or distribution
        self.size, self.crops_per_panorama = size, crops_per_panorama
        self.batch_size, self.eval_batch_size = batch_size, eval_batch_size
        self.seed, self.workers, self.augment = seed, workers, augment
        self.canvas, self.detail, self.geometric_height = canvas, detail, geometric_height
        self._splits: dict[str, Crops] = {}

    def setup(self, stage: str) -> None:
        """Read the panoramas that ``stage`` needs: training and validation for ``fit``, test for ``test``."""
        for split in {"fit": ("train", "val"), "validate": ("val",), "test": ("test",)}.get(stage, ()):
            if split not in self._splits:
                distribution = self.test_distribution if split == "test" else self.distribution
                draws = {"train": self.seed, "val": VALIDATION, "test": TEST}[split]
                panoramas = self.source.read(split)  # type: ignore[arg-type]
                augment = self.augment and split == "train"
                self._splits[split] = Crops(
                    panoramas, distribution, self.size[1], self.size[0], draws, augment=augment, keep=split == "val",
                    canvas=self.canvas, detail=self.detail if split == "train" else None,
                )  # fmt: skip

    def split(self, name: str) -> Crops:
        """The crops of ``train``, ``val`` or ``test``, once :meth:`setup` has read them."""
        return self._splits[name]

    def count(self, name: str) -> int:
        """Number of crops in a split; for ``train``, in an epoch."""
        return len(self._splits[name].panoramas) * self.crops_per_panorama[name]

    def distribution_sample(self) -> CameraParameters:
        """Cameras of the training distribution, for methods that learn only from labels."""
        numbers = np.arange(20_000)
        return self.distribution.draw_for(numbers, np.zeros_like(numbers), self.seed).cameras

    def larger(self, name: str) -> Crops:
        """The same crops at the size used for geometric methods."""
        crops = self._splits[name]
        width = round(self.geometric_height * self.size[1] / self.size[0])
        return Crops(crops.panoramas, crops.distribution, width, self.geometric_height, crops.seed)

    def train_dataloader(self) -> DataLoader[CropBatch]:
        """New crops every epoch, a function of (seed, epoch)."""
        batches = EpochBatches(self.count("train"), self.batch_size, self.seed, numbered=True)
        batches.set_epoch(epoch_of(self.trainer))
        return loader(SharedBatches(self._splits["train"], Share.of_trainer(self.trainer)), batches, self.workers)

    def val_dataloader(self) -> DataLoader[CropBatch]:
        """The same validation crops in every epoch."""
        return loader(self._splits["val"], EpochBatches(self.count("val"), self.eval_batch_size))

    def test_dataloader(self) -> DataLoader[CropBatch]:
        """Test crops in order."""
        return loader(self._splits["test"], EpochBatches(self.count("test"), self.eval_batch_size))
