"""Datasets of labelled images."""

from typing import Literal

from pydantic import Field

from sextant.config.schema.parts import Part, Share


class LabelledImages(Part):
    """A dataset of labelled images."""


class Digits(LabelledImages):
    """scikit-learn's digit scans."""

    target: Literal["sextant.data.digits.Digits"] = Field(alias="_target_")
    size: int = Field(ge=12, le=512, examples=[28])


class MNIST(LabelledImages):
    """MNIST."""

    target: Literal["sextant.data.mnist.MNIST"] = Field(alias="_target_")
    download: bool


class FashionMNIST(LabelledImages):
    """Fashion-MNIST."""

    target: Literal["sextant.data.mnist.FashionMNIST"] = Field(alias="_target_")
    download: bool


class CIFAR10(LabelledImages):
    """CIFAR-10."""

    target: Literal["sextant.data.cifar10.CIFAR10"] = Field(alias="_target_")
    train_batches: int = Field(ge=1, le=5, examples=[5])
    download: bool


class ImageFolder(LabelledImages):
    """The user's own images."""

    target: Literal["sextant.data.image_folder.ImageFolder"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/images"])
    size: int = Field(ge=12, le=1024, examples=[64])
    channels: Literal[1, 3]
    test_fraction: Share = Field(examples=[0.2])
