"""A digit under every corruption, as classified by two networks: one with a convolution first, one with push-pull."""

from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image
from scipy.ndimage import center_of_mass

from sextant import zoo
from sextant.chapters.classification.classifier import ImageClassifier
from sextant.chapters.cosfire.images import read_image
from sextant.corruptions import BenchmarkSuite
from sextant.data.digits import Digits
from sextant.errors import ArgumentError, UserError
from sextant.tools.demonstration.pictures import data_address

#: names of the networks, and where they are
NETWORKS = {"convolution": "zoo:digits", "push_pull": "zoo:digits_push_pull"}
#: in MNIST: side of the images, and of the box that digits were fitted into
SIDE, BOX = 28, 20
#: longest side at which a picture is processed, in pixels
LONGEST = 400
#: of 255: on black paper, brighter pixels are ink; a picture with less contrast than the second has none
INK, FAINT = 64, 48
#: ratio of width to height from which it is not a digit: of 20,000 of MNIST none is wider
WIDEST = 2.0


class DigitTrial:
    """Classifies digits under the 19 corruptions of CIFAR-10-C at five severities, applied at the size of the digits.

    >>> found = DigitTrial.load().answer(Path("seven.png"))  # doctest: +SKIP
    >>> print(found["clean"], found["names"][0], found["answers"][0])  # doctest: +SKIP

    Args:
        networks: networks by name.
        errors: their errors on test digits, from their cards, by name.
    """

    def __init__(self, networks: dict[str, ImageClassifier], errors: dict[str, Any]):
        self.networks, self.errors = networks, errors
        self.suite = BenchmarkSuite("cifar10_c")

    @classmethod
    def load(cls) -> Self:
        """Load the networks of the package."""
        cards = {name: zoo.read_card(zoo.model_file(each)) for name, each in NETWORKS.items()}
        networks = {name: ImageClassifier.load(each) for name, each in NETWORKS.items()}
        return cls(networks, {name: card["metrics"] for name, card in cards.items()})

    def answer(self, picture: Path) -> dict[str, Any]:
        """The networks' answers for a picture of a digit, clean and corrupted.

        Raises:
            UserError: the picture cannot be read, or has no digit in it.
        """
        return self.of(digit_of(read_image(picture, LONGEST).picture))

    def of_scan(self, digit: int) -> dict[str, Any]:
        """The answers for a handwritten digit, one of the scans that come with scikit-learn.

        Raises:
            UserError: there is no such digit.
        """
        scans = Digits(SIDE).read("test")
        if digit not in scans.labels:
            raise ArgumentError(f"digit={digit} must be one of 0 to 9")
        return self.of(centred(scans.images[int((scans.labels == digit).argmax()), 0]))

    def of(self, digit: UInt8[ndarray, "28 28"]) -> dict[str, Any]:
        """The answers for a digit in MNIST's format: white on black, 28 pixels a side."""
        clean = torch.from_numpy(digit.copy())[None, None].float() / 255
        conditions = self.suite.conditions()
        index = torch.zeros(1, dtype=torch.int64)
        images = torch.cat([self.suite.corrupt(clean, index, each) for each in conditions])
        pixels = (images.clamp(0, 1) * 255).round().to(torch.uint8)
        said = {name: network.probabilities(pixels).max(1) for name, network in self.networks.items()}
        answers = [
            {name: [int(best.indices[i]), float(best.values[i])] for name, best in said.items()}
            for i in range(len(conditions))
        ]
        names, levels = list(self.suite.corruptions), range(1, 1 + (len(conditions) - 1) // len(self.suite.corruptions))
        return {
            "picture": data_address(digit),
            "clean": answers[0],
            "names": names,
            "severities": list(levels),
            "answers": [answers[1 + i * len(levels) :][: len(levels)] for i in range(len(names))],
            "pictures": data_address(_sheet(pixels[1:, 0].numpy(), len(levels))),
            "on_test_digits": self.errors,
        }


def digit_of(picture: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "28 28"]:
    """The digit in a picture in MNIST's format; it may be dark on bright or bright on dark.

    Raises:
        UserError: the picture is empty, or shows something far wider than high.
    """
    grey = np.asarray(Image.fromarray(picture).convert("L")).astype(np.float32)
    edge = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    ink = np.abs(grey - np.median(edge))
    if ink.max() < FAINT:
        raise UserError("the picture is blank", "Draw one digit, large and in one piece.")
    return centred((255 * ink / ink.max()).astype(np.uint8))


def centred(ink: UInt8[ndarray, "h w"]) -> UInt8[ndarray, "28 28"]:
    """Fit a digit into a box of 20 pixels and put its centre of mass in the middle of 28, as in MNIST.

    Raises:
        UserError: it is far wider than high.
    """
    rows, columns = np.nonzero(ink > INK)
    wide = (np.ptp(columns) + 1) / (np.ptp(rows) + 1)
    if wide >= WIDEST:
        raise UserError(
            f"the drawing is {wide:.1f} times as wide as high, which no digit is",
            "Draw one digit, upright.",
        )
    part = Image.fromarray(ink[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1])
    scale = BOX / max(part.size)
    size = (max(1, round(part.width * scale)), max(1, round(part.height * scale)))
    small = np.asarray(part.resize(size, Image.Resampling.BOX if scale < 1 else Image.Resampling.BICUBIC))
    y, x = center_of_mass(small.astype(np.float64))
    top, left = (round(min(max(SIDE / 2 - 0.5 - mass, 0), SIDE - side)) for mass, side in ((y, size[1]), (x, size[0])))
    digit = np.zeros((SIDE, SIDE), np.uint8)
    digit[top : top + size[1], left : left + size[0]] = small
    return digit


def _sheet(images: UInt8[ndarray, "n 28 28"], columns: int) -> UInt8[ndarray, "y x"]:
    """All images as one, in rows of ``columns`` images."""
    side = images.shape[-1]
    sheet: UInt8[ndarray, "y x"] = images.reshape(-1, columns, side, side).swapaxes(1, 2).reshape(-1, columns * side)
    return sheet
