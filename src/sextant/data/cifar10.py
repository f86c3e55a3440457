"""CIFAR-10 and CIFAR-100 in the publisher's Python format; no code that its pickles might contain is executed."""

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
MD5_100 = {"train": "16019d7e3df5f24257cddd939b257f8d", "test": "f0ef6b0ae62326f3e7ffdfab6717acfc"}
BATCH = 10_000
CLASSES = ("airplane", "automobile", "bird", "cat", "deer", "dog", "frog", "horse", "ship", "truck")
CLASSES_100 = (
    "apple", "aquarium_fish", "baby", "bear", "beaver", "bed", "bee", "beetle", "bicycle", "bottle", "bowl", "boy",
    "bridge", "bus", "butterfly", "camel", "can", "castle", "caterpillar", "cattle", "chair", "chimpanzee", "clock",
    "cloud", "cockroach", "couch", "crab", "crocodile", "cup", "dinosaur", "dolphin", "elephant", "flatfish",
    "forest", "fox", "girl", "hamster", "house", "kangaroo", "keyboard", "lamp", "lawn_mower", "leopard", "lion",
    "lizard", "lobster", "man", "maple_tree", "motorcycle", "mountain", "mouse", "mushroom", "oak_tree", "orange",
    "orchid", "otter", "palm_tree", "pear", "pickup_truck", "pine_tree", "plain", "plate", "poppy", "porcupine",
    "possum", "rabbit", "raccoon", "ray", "road", "rocket", "rose", "sea", "seal", "shark", "shrew", "skunk",
    "skyscraper", "snail", "snake", "spider", "squirrel", "streetcar", "sunflower", "sweet_pepper", "table", "tank",
    "telephone", "television", "tiger", "tractor", "train", "trout", "tulip", "turtle", "wardrobe", "whale",
    "willow_tree", "wolf", "woman", "worm",
)  # fmt: skip


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


class CIFAR100(ImageSource):
    """60,000 colour images of 32x32 pixels in a hundred classes (fine labels), 10,000 of them for testing.

    Args:
        roots: folders to search for ``cifar-100-python/``; a download is written to the last one.
        download: let torchvision fetch what is missing.
    """

    name = "cifar100"

    def __init__(self, roots: Sequence[Path | str], download: bool = False):
        self.roots = [Path(root) for root in roots]
        self.download = download

    def files(self, split: Split) -> list[Path]:
        """The file of ``split``."""
        try:
            folder = self._find(split)
        except MissingDataError:
            if not self.download:
                raise
            torchvision_download("CIFAR100", self.roots[-1], split == "train")
            folder = self._find(split)
        return [folder / split]

    def _find(self, split: Split) -> Path:
        source = "cifar-100-python.tar.gz, unpacked"
        return find_folder(self.roots, "cifar-100-python", [split], dataset=self.name, source=source)

    def spec(self) -> ImageSpec:
        """Three channels, 32x32, a hundred classes."""
        return ImageSpec(3, 32, 32, CLASSES_100)

    def count(self, split: Split) -> int:
        """50,000 or 10,000 images."""
        return BATCH if split == "test" else 5 * BATCH

    def read(self, split: Split) -> LabelledImages:
        """Read a split after checking the MD5 of its file."""
        (path,) = self.files(split)
        check_file(path, MD5_100[split], "md5")
        batch = _ArraysOnly(io.BytesIO(path.read_bytes()), encoding="bytes").load()
        return LabelledImages(batch[b"data"].reshape(-1, 3, 32, 32), np.asarray(batch[b"fine_labels"], np.int64))


class _ArraysOnly(pickle.Unpickler):
    """Reads pickled containers and numpy arrays; anything else that a pickle could call is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith("numpy") and name in ("_reconstruct", "ndarray", "dtype"):
            module = module.replace("numpy.core", "numpy._core")
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is not allowed in a batch of CIFAR")
