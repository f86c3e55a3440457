"""CIFAR-10 in the publisher's Python format, read without executing code that its pickles might contain."""

import io
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sextant.data.download import torchvision_download
from sextant.data.source import ImageSource, ImageSpec, LabelledImages, MissingDataError, Split, check_file, find_folder

MD5 = {
    "data_batch_1": "c99cafc152244af753f735de768cd75f",
    "data_batch_2": "d4bba439e000b95fd0a9bffe97cbabec",
    "data_batch_3": "54ebc095f3ab1f0389bbae665268c751",
    "data_batch_4": "634d18415352ddfa80567beed471001a",
    "data_batch_5": "482c414d41f54cd18b22e5b47cb7c3cb",
    "test_batch": "40351d587109b95175f43aff81a1287e",
}
BATCH = 10_000
CLASSES = ("airplane", "automobile", "bird", "cat", "deer", "dog", "frog", "horse", "ship", "truck")


class CIFAR10(ImageSource):
    """60,000 colour images of 32x32 pixels in ten classes, 10,000 of them for testing.

    Source: A. Krizhevsky, "Learning multiple layers of features from tiny images", 2009. Only the files that a split
    needs are required and checked, so the test batch alone is enough for evaluation.

    Args:
        roots: folders to search for ``cifar-10-batches-py/``; a download is written to the last one.
        train_batches: how many of the five training batches make the training split.
        download: let torchvision fetch what is missing.
    """

    name = "cifar10"

    def __init__(self, roots: Sequence[Path | str], train_batches: int = 5, download: bool = False):
        self.roots = [Path(root) for root in roots]
        self.train_batches = train_batches
        self.download = download

    def files(self, split: Split) -> list[Path]:
        """The batches of ``split``."""
        names = ["test_batch"] if split == "test" else [f"data_batch_{i + 1}" for i in range(self.train_batches)]
        try:
            folder = self._find(names)
        except MissingDataError:
            if not self.download:
                raise
            torchvision_download("CIFAR10", self.roots[-1], split == "train")
            folder = self._find(names)
        return [folder / name for name in names]

    def _find(self, names: Sequence[str]) -> Path:
        source = "cifar-10-python.tar.gz, unpacked; train_batches=1 needs the first batch alone"
        return find_folder(self.roots, "cifar-10-batches-py", names, dataset=self.name, source=source)

    def spec(self) -> ImageSpec:
        """Three channels, 32x32, ten classes."""
        return ImageSpec(3, 32, 32, CLASSES)

    def count(self, split: Split) -> int:
        """10,000 images per batch."""
        return BATCH * (1 if split == "test" else self.train_batches)

    def read(self, split: Split) -> LabelledImages:
        """Read a split after checking the MD5 of its files."""
        images, labels = [], []
        for path in self.files(split):
            check_file(path, MD5[path.name], "md5")
            batch = _ArraysOnly(io.BytesIO(path.read_bytes()), encoding="bytes").load()
            images.append(batch[b"data"].reshape(-1, 3, 32, 32))
            labels.append(np.asarray(batch[b"labels"], np.int64))
        return LabelledImages(np.concatenate(images), np.concatenate(labels))


class _ArraysOnly(pickle.Unpickler):
    """Reads pickled containers and numpy arrays; anything else that a pickle could call is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith("numpy") and name in ("_reconstruct", "ndarray", "dtype"):
            module = module.replace("numpy.core", "numpy._core")
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is not allowed in a CIFAR-10 batch")
