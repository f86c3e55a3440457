"""A trained classifier: maps images to class probabilities."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Self, overload

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray
from PIL import Image
from torch import Tensor, nn

from sextant.applications.failures import Errors, FailedPhoto, raise_failed, several
from sextant.applications.pixels import AnyImage, checked_pixels
from sextant.data.image_folder import covering_bytes, decode_covering
from sextant.data.pixel_values import WhiteLevels
from sextant.data.source import ImageSpec
from sextant.errors import ArgumentError, UserError
from sextant.kit.trained import image_spec, own_config, read_trained, trained_network
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.shapes import check_shape

#: images that are classified at a time
BATCH = 256
#: maps images to a number for each class
Answering = Callable[[UInt8[Tensor, "b c h w"]], Float[Tensor, "b k"]]


@dataclass(frozen=True)
class Classified:
    """The classification of an image.

    Attributes:
        probabilities: probability of each class, in [0, 1], in the order of training; they sum to 1.
    """

    probabilities: Mapping[str, float]

    @property
    def label(self) -> str:
        """The most probable class."""
        return max(self.probabilities, key=self.probabilities.__getitem__)

    @property
    def probability(self) -> float:
        """The probability of that class."""
        return self.probabilities[self.label]


class ImageClassifier:
    """Classifies images with the network of a classification run, or a published push-pull network.

    >>> classifier = ImageClassifier.load("outputs/runs/classification/1a2b3c4d-s0")  # doctest: +SKIP
    >>> found = classifier.classify("photo.jpg")  # doctest: +SKIP
    >>> print(found.label, found.probability)  # doctest: +SKIP

    Args:
        network: maps images in [0, 1], ``(b, c, h, w)``, to logits ``(b, k)``.
        spec: shape of its images, and its classes.
        name: name of the network, for error messages.
    """

    def __init__(self, network: nn.Module, spec: ImageSpec, name: str = "this network"):
        self.network, self.spec, self.name = network.eval(), spec, name

    @classmethod
    def load(cls, run: Path | str, outputs: Path | str | None = None, *, trust: bool = False) -> Self:
        """The classifier of a run.

        Args:
            run: an MLflow run id, a run directory or its name, a checkpoint, or a published ``.pth.tar``.
            outputs: folder of runs; the folder that runs are written to by default.
            trust: build user-defined parts that the checkpoint names.

        Raises:
            UserError: there is no such run, its file is damaged, or it is of another task.
        """
        found = resolve_run(str(run), default_outputs() if outputs is None else Path(outputs).expanduser())
        return cls.of(read_trained(found.checkpoint), found.checkpoint, trust=trust)

    @classmethod
    def of(cls, content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False) -> Self:
        """The classifier of a checkpoint that has been read already.

        Raises:
            UserError: as for :meth:`load`.
        """
        trained = content[KEY]
        if trained["task"] != "classification":
            raise UserError(f"{checkpoint} is a model of {trained['task']}, not of classification")
        config = own_config(trained, trust=trust)
        return cls(trained_network(config, content, checkpoint), image_spec(trained["spec"]), str(checkpoint))

    def classify(self, image: AnyImage) -> Classified:
        """Classify one image.

        Args:
            image: a file, a Pillow image or an array, as for :meth:`classify_many`.

        Raises:
            UserError: the image cannot be read or has another shape, or the network returns NaN.
        """
        (found,) = self.classify_many([image], errors="return")
        if isinstance(found, FailedPhoto):
            raise found.error
        return found

    @overload
    def classify_many(self, images: Iterable[AnyImage], *, errors: Literal["raise"] = "raise") -> list[Classified]: ...
    @overload
    def classify_many(
        self, images: Iterable[AnyImage], *, errors: Literal["return"]
    ) -> list[Classified | FailedPhoto]: ...
    def classify_many(
        self, images: Iterable[AnyImage], *, errors: Errors = "raise"
    ) -> list[Classified] | list[Classified | FailedPhoto]:
        """Classify several images; results are in the same order.

        Args:
            images: files of any kind and size, or Pillow images, which are turned upright, scaled to cover the
                network's images and cropped at the centre; or arrays of whole numbers from 0 to 255 of the size of the
                network's images.
            errors: ``raise`` tries all images, then raises if some failed; ``return`` puts a
                :class:`~sextant.applications.FailedPhoto` in place of each failure.

        Raises:
            FailedPhotosError: files cannot be read, or arrays have another shape; it names all of them.
            UserError: the network returns NaN.
        """
        given = iter(enumerate(several(images, errors, "images")))
        found: list[Classified | FailedPhoto] = []
        while batch := [self._tried(i, image) for i, image in islice(given, BATCH)]:
            pixels = [each for each in batch if isinstance(each, ndarray)]
            rows = iter(class_numbers(pixels, self.probabilities, self.name))
            found += [
                each
                if isinstance(each, FailedPhoto)
                else Classified(dict(zip(self.spec.classes, next(rows), strict=True)))
                for each in batch
            ]
        raise_failed(found, len(found), "classified", errors)
        return found

    @torch.no_grad()
    def probabilities(self, images: UInt8[Tensor, "b c h w"]) -> Float32[Tensor, "b k"]:
        """Class probabilities for images of bytes.

        Raises:
            UserError: the images are not bytes or have another shape, or the network returns NaN.
        """
        if images.dtype != torch.uint8:
            fix = "Of numbers in [0, 1], for example (images * 255).round().to(torch.uint8)."
            raise ArgumentError(f"images hold {images.dtype}, not torch.uint8", fix)
        check_shape("images", images, "b", self.spec.channels, self.spec.height, self.spec.width)
        device = next(self.network.parameters()).device
        return _numbers(self.network(images.to(device).float() / 255).softmax(1).cpu(), self.name)

    def _tried(self, number: int, image: AnyImage) -> UInt8[ndarray, "h w c"] | FailedPhoto:
        try:
            return self._pixels(image)
        except UserError as error:
            return FailedPhoto(str(image) if isinstance(image, Path | str) else f"image {number}", error)

    def _pixels(self, image: AnyImage) -> UInt8[ndarray, "h w c"]:
        size, channels = (self.spec.height, self.spec.width), self.spec.channels
        if isinstance(image, Path | str):
            image = decoded(Path(image).expanduser(), self.spec)
        elif isinstance(image, Image.Image):
            try:
                image = covering_bytes(image, size, channels)
            except (ValueError, OSError) as error:  # Pillow decodes lazily
                raise UserError(f"the image cannot be used: {error}", "Give another.") from None
        return checked_pixels(image, (*size, channels))


def decoded(path: Path, spec: ImageSpec, levels: WhiteLevels | None = None) -> UInt8[ndarray, "h w *c"]:
    """An image file as a network of ``spec`` takes it: upright, scaled to cover its images, cropped at the centre.

    Raises:
        UserError: it cannot be decoded.
    """
    return decode_covering(path, (spec.height, spec.width), spec.channels, levels)


@torch.no_grad()
def class_numbers(images: Sequence[UInt8[ndarray, "h w *c"]], answer: Answering, model: str) -> list[list[float]]:
    """What a model answers about images, a number for each class.

    Args:
        images: as :func:`decoded` returns them.
        answer: computes the numbers.
        model: name of the model, for error messages.

    Raises:
        UserError: a number is NaN.
    """
    if not images:
        return []
    stacked = np.stack(images)
    stacked = stacked[:, None] if stacked.ndim == 3 else stacked.transpose(0, 3, 1, 2)
    found: list[list[float]] = _numbers(answer(torch.from_numpy(stacked.copy())), model).tolist()
    return found


def _numbers(found: Float[Tensor, "b k"], model: str) -> Float[Tensor, "b k"]:
    if bool(found.isnan().any()):
        raise UserError(
            f"the model in {model} returns NaN",
            "Its weights are damaged, or its training diverged. Use another checkpoint.",
        )
    return found
