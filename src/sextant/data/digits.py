"""The 1,797 real digit scans that come with scikit-learn: the dataset that needs no download."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

from sextant.data.source import ImageSource, ImageSpec, LabelledImages, Split, channels_first, check_file

SHA256 = "09f66e6debdee2cd2b5ae59e0d6abbb73fc2b0e0185d2e1957e9ebb51e23aa22"
SCANS, TEST_FRACTION = 1_797, 0.2


class Digits(ImageSource):
    """Handwritten digits, 8x8 pixels with 17 grey levels, enlarged bicubically.

    Source: E. Alpaydin & C. Kaynak, "Optical Recognition of Handwritten Digits", UCI 1998 (its test part). There is no
    official split of this part: a fixed permutation puts one fifth into the test split.

    Args:
        size: side of the enlarged images in pixels.
        roots: not used; the scans come with the scikit-learn package.
    """

    name = "digits"

    def __init__(self, size: int = 28, roots: Sequence[Path | str] = ()):
        self.size = size

    def files(self, split: Split) -> list[Path]:
        """The one file of both splits; it is found without importing scikit-learn, which takes seconds."""
        package = find_spec("sklearn")
        assert package is not None
        assert package.submodule_search_locations is not None
        return [Path(package.submodule_search_locations[0], "datasets", "data", "digits.csv.gz")]

    def spec(self) -> ImageSpec:
        """One channel, ten classes."""
        return ImageSpec(1, self.size, self.size, tuple("0123456789"))

    def count(self, split: Split) -> int:
        """1,438 for training, 359 for the test."""
        tests = round(TEST_FRACTION * SCANS)
        return tests if split == "test" else SCANS - tests

    def read(self, split: Split) -> LabelledImages:
        """Read a split."""
        (path,) = self.files(split)
        check_file(path, SHA256)
        rows = np.loadtxt(path, delimiter=",", dtype=np.uint8)
        order = np.random.default_rng(0).permutation(len(rows))
        tests = round(TEST_FRACTION * len(rows))
        rows = rows[order[:tests] if split == "test" else order[tests:]]
        scans = (rows[:, :-1].astype(np.uint16) * 255 // 16).astype(np.uint8).reshape(-1, 8, 8)
        target = (self.size, self.size)
        images = np.stack([np.asarray(Image.fromarray(s).resize(target, Image.Resampling.BICUBIC)) for s in scans])
        return LabelledImages(channels_first(images), rows[:, -1].astype(np.int64))
