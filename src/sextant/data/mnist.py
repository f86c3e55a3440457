"""MNIST and Fashion-MNIST, in the idx format of their publishers and the folder layout of torchvision."""

import gzip
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from sextant.data.download import torchvision_download
from sextant.data.source import (
    ImageSource,
    ImageSpec,
    LabelledImages,
    MissingDataError,
    Split,
    channels_first,
    check_file,
    find_folder,
)
from sextant.errors import UserError

PREFIX: dict[str, str] = {"train": "train", "test": "t10k"}
COUNT: dict[str, int] = {"train": 60_000, "test": 10_000}


class MNIST(ImageSource):
    """70,000 handwritten digits of 28x28 pixels, 60,000 of them for training.

    Source: Y. LeCun, C. Cortes, C. Burges, "The MNIST database of handwritten digits", 1998. Unpacked files are checked
    against their SHA-256.

    Args:
        roots: folders to search for ``MNIST/raw/``; a download is written to the last one.
        download: let torchvision fetch what is missing.
    """

    name = "mnist"
    folder: ClassVar[str] = "MNIST/raw"
    classes: ClassVar[tuple[str, ...]] = tuple("0123456789")
    sha256: ClassVar[dict[str, str]] = {
        "train-images-idx3-ubyte": "ba891046e6505d7aadcbbe25680a0738ad16aec93bde7f9b65e87a2fc25776db",
        "train-labels-idx1-ubyte": "65a50cbbf4e906d70832878ad85ccda5333a97f0f4c3dd2ef09a8a9eef7101c5",
        "t10k-images-idx3-ubyte": "0fa7898d509279e482958e8ce81c8e77db3f2f8254e26661ceb7762c4d494ce7",
        "t10k-labels-idx1-ubyte": "ff7bcfd416de33731a308c3f266cc351222c34898ecbeaf847f06e48f7ec33f2",
    }
    gz_md5: ClassVar[dict[str, str]] = {}

    def __init__(self, roots: Sequence[Path | str], download: bool = False):
        self.roots = [Path(root) for root in roots]
        self.download = download

    def files(self, split: Split) -> list[Path]:
        """Images and labels of ``split``."""
        names = [f"{PREFIX[split]}-images-idx3-ubyte", f"{PREFIX[split]}-labels-idx1-ubyte"]
        try:
            folder = self._find(names)
        except MissingDataError:
            if not self.download:
                raise
            torchvision_download(type(self).__name__, self.roots[-1], split == "train")
            folder = self._find(names)
        return [folder / name for name in names]

    def _find(self, names: Sequence[str]) -> Path:
        return find_folder(self.roots, self.folder, names, dataset=self.name, source="torchvision's layout")

    def spec(self) -> ImageSpec:
        """One channel, 28x28, ten classes."""
        return ImageSpec(1, 28, 28, self.classes)

    def count(self, split: Split) -> int:
        """60,000 for training, 10,000 for the test."""
        return COUNT[split]

    def read(self, split: Split) -> LabelledImages:
        """Read a split after checking its two files."""
        images, labels = (self._read_checked(path) for path in self.files(split))
        if images.shape != (COUNT[split], 28, 28) or labels.shape != (COUNT[split],):
            raise UserError(f"dataset={self.name}: {split} images have shape {images.shape}, labels {labels.shape}")
        return LabelledImages(channels_first(images), labels.astype(np.int64))

    def _read_checked(self, path: Path) -> np.ndarray:
        if path.name in self.sha256:
            check_file(path, self.sha256[path.name])
        packed = path.with_name(path.name + ".gz")
        if packed.name in self.gz_md5 and packed.is_file():  # the published hash is that of the packed file
            check_file(packed, self.gz_md5[packed.name], "md5")
            return read_idx(packed)
        return read_idx(path)


class FashionMNIST(MNIST):
    """70,000 pictures of clothing in the format of MNIST.

    Source: H. Xiao, K. Rasul, R. Vollgraf, "Fashion-MNIST", arXiv:1708.07747. The publisher's MD5 is that of the packed
    files. If these lie beside the unpacked ones, they are read and checked; otherwise only header and length are
    checked.
    """

    name = "fashion_mnist"
    folder = "FashionMNIST/raw"
    classes = ("t-shirt", "trouser", "pullover", "dress", "coat", "sandal", "shirt", "sneaker", "bag", "ankle boot")
    sha256: ClassVar[dict[str, str]] = {}
    gz_md5: ClassVar[dict[str, str]] = {
        "train-images-idx3-ubyte.gz": "8d4fb7e6c68d591d4c3dfef9ec88bf0d",
        "train-labels-idx1-ubyte.gz": "25c81989df183df01b3e8a0aad5dffbe",
        "t10k-images-idx3-ubyte.gz": "bef4ecab320f06d8554ea6380940ec79",
        "t10k-labels-idx1-ubyte.gz": "bb300cfdad3c16e7a12a480ee83cd310",
    }


def read_idx(path: Path) -> np.ndarray:
    """Read an idx file of unsigned bytes, possibly gzipped, as an array.

    Raises:
        UserError: the file is not of this format, or its length differs from that in its header.
    """
    try:
        content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    except (OSError, EOFError, zlib.error) as error:
        raise UserError(f"{path} cannot be read: {error}", "Delete it and fetch it again.") from None
    header = 4 + 4 * content[3] if len(content) >= 4 else 0
    if content[:3] != b"\x00\x00\x08" or len(content) < header:
        raise UserError(f"{path} is not an idx file of unsigned bytes ({len(content):,} bytes)", "Fetch it again.")
    shape = struct.unpack(f">{content[3]}I", content[4:header])
    expected = header + int(np.prod(shape))
    if len(content) != expected:
        raise UserError(
            f"{path} is truncated: {len(content):,} bytes, its header gives {expected:,}", "Fetch it again."
        )
    return np.frombuffer(bytearray(content), np.uint8, offset=header).reshape(shape)  # writable, as torch wants it
