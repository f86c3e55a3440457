"""The config of images: data sets with labels, augmentations, and the corruptions of any task."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from sextant.config.schema.parts import Choice, Part, distinct
from sextant.ranges import NonNegative, Positive, Seed, Share


class Dataset(Part):
    """A data set of any task."""


class Augmentation(Part):
    """An augmentation of training images."""


class NoAugmentation(Augmentation):
    """Unchanged training images."""

    target: Literal["sextant.data.augmentation.NoAugmentation"] = Field(alias="_target_")


class PadCropFlip(Augmentation):
    """Random shifts and mirror images."""

    target: Literal["sextant.data.augmentation.PadCropFlip"] = Field(alias="_target_")
    pad: int = Field(ge=0, le=64, examples=[4])
    mode: Literal["reflect", "replicate", "constant"]
    flip: bool


class AugMix(Augmentation):
    """AugMix."""

    target: Literal["sextant.data.augmentation.AugMix"] = Field(alias="_target_")
    severity: int = Field(ge=1, le=10, examples=[3])
    width: int = Field(ge=1, le=16, examples=[3])
    depth: int = Field(ge=-1, le=16, examples=[-1])
    alpha: Positive = Field(examples=[1.0])
    pad: int = Field(ge=0, le=64, examples=[4])
    flip: bool


class Corruption(Part):
    """One corruption at its severities."""


class GaussianNoise(Corruption):
    """Additive Gaussian noise."""

    target: Literal["sextant.corruptions.GaussianNoise"] = Field(alias="_target_")
    levels: Annotated[list[NonNegative], AfterValidator(distinct)] = Field(min_length=1, examples=["[0.01,0.1]"])
    clip: bool


class ContrastPoisson(Corruption):
    """Loss of contrast, then photon noise."""

    target: Literal["sextant.corruptions.ContrastPoisson"] = Field(alias="_target_")
    levels: Annotated[list[Annotated[float, Field(gt=0, le=1)]], AfterValidator(distinct)] = Field(
        min_length=1, examples=["[0.5,0.2]"]
    )
    peak: Positive = Field(examples=[256.0])
    clip: bool


class TestConditions(Part):
    """The conditions under which a model is tested."""


class CorruptionSuite(TestConditions):
    """The test conditions."""

    target: Literal["sextant.corruptions.CorruptionSuite"] = Field(alias="_target_")
    corruptions: dict[str, Choice[Corruption]]
    seed: Seed = Field(examples=[0])


class BenchmarkSuite(TestConditions):
    """A published set of test conditions."""

    target: Literal["sextant.corruptions.BenchmarkSuite"] = Field(alias="_target_")
    set: Literal["cifar10_c", "cifar100_c", "mnist_c", "imagenet_c"]
    names: str | list[str] | None = Field(examples=["benchmark15"])
    severities: Annotated[list[int], AfterValidator(distinct)] | None = Field(examples=["[1,3,5]"])
    mode: Literal["faithful", "corrected"]
    quantise: bool
    seed: Seed = Field(examples=[0])
    beside: dict[str, Choice[Corruption]] | None = None


class StoredSuite(TestConditions):
    """A published set of test conditions, from files."""

    target: Literal["sextant.corruptions.StoredSuite"] = Field(alias="_target_")
    folder: str = Field(examples=["CIFAR-10-C"])
    set: Literal["cifar10_c", "cifar100_c", "mnist_c", "imagenet_c"]
    names: str | list[str] | None = Field(examples=["benchmark15"])
    severities: Annotated[list[int], AfterValidator(distinct)] | None = Field(examples=["[1,3,5]"])


class PerturbationSuite(TestConditions):
    """Sequences in which an image changes gradually."""

    target: Literal["sextant.corruptions.PerturbationSuite"] = Field(alias="_target_")
    names: list[str] | None = Field(examples=["[translate,rotate]"])
    seed: Seed = Field(examples=[0])


class LabelledImages(Dataset):
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

    later = ("crop",)
    target: Literal["sextant.data.image_folder.ImageFolder"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/images"])
    size: int = Field(ge=12, le=1024, examples=[64])
    channels: Literal[1, 3]
    test_fraction: Share = Field(examples=[0.2])
    crop: float | None = Field(default=None, gt=0, le=1, examples=[0.875])


class CIFAR100(LabelledImages):
    """CIFAR-100."""

    target: Literal["sextant.data.cifar10.CIFAR100"] = Field(alias="_target_")
    download: bool
