"""A trained classifier: images in, probabilities of classes out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.applications.pixels import checked_pixels
from sextant.data.image_folder import decode_square
from sextant.data.source import ImageSpec
from sextant.errors import UserError
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.trained.content import own_config, read_trained
from sextant.trained.image_spec import image_spec
from sextant.trained.networks import trained_network

#: images that are classified at a time
BATCH = 256


@dataclass(frozen=True)
class Classified:
    """What an image shows.

    Attributes:
        probabilities: of each class, in [0, 1], in the order of training; they sum to 1.
    """

    probabilities: Mapping[str, float]

    @property
    def label(self) -> str:
        """The most probable class."""
        return max(self.probabilities, key=self.probabilities.__getitem__)

    @property
    def probability(self) -> float:
        """Of the most probable class."""
        return self.probabilities[self.label]


class ImageClassifier:
    """Classifies images with the network of a run of classification, or a published push-pull network.

    >>> classifier = ImageClassifier.load("outputs/runs/classification/1a2b3c4d-s0")  # doctest: +SKIP
    >>> seen = classifier.classify("photo.jpg")  # doctest: +SKIP
    >>> print(seen.label, seen.probability)  # doctest: +SKIP

    Args:
        network: maps images in [0, 1], ``(b, c, h, w)``, to logits ``(b, k)``.
        spec: shape of its images, and its classes.
        name: of the network, for messages.
    """

    def __init__(self, network: nn.Module, spec: ImageSpec, name: str = "this network"):
        self.network, self.spec, self.name = network.eval(), spec, name

    @classmethod
    def load(cls, run: Path | str, outputs: Path | str | None = None, *, trust: bool = False) -> Self:
        """The classifier of a run.

        Args:
            run: an MLflow run id, a run directory or its name, a checkpoint, or a published ``.pth.tar``.
            outputs: folder of runs; where runs are written unless given.
            trust: build parts of the user's own that the checkpoint names.

        Raises:
            UserError: there is no such run, its file is damaged, or it is one of another task.
        """
        found = resolve_run(str(run), default_outputs() if outputs is None else Path(outputs).expanduser())
        return cls.of(read_trained(found.checkpoint), found.checkpoint, trust=trust)

    @classmethod
    def of(cls, content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False) -> Self:
        """The classifier of a checkpoint that was read.

        Raises:
            UserError: as :meth:`load`.
        """
        trained = content[KEY]
        if trained["task"] != "classification":
            raise UserError(f"{checkpoint} is a model of {trained['task']}, not of classification")
        raw, _ = own_config(trained, trust=trust)
        return cls(trained_network(raw, content, checkpoint), image_spec(trained["spec"]), str(checkpoint))

    def classify(self, image: Path | str | UInt8[ndarray, "h w *c"]) -> Classified:
        """What an image shows; see :meth:`classify_many`."""
        return self.classify_many([image])[0]

    def classify_many(self, images: Sequence[Path | str | UInt8[ndarray, "h w *c"]]) -> list[Classified]:
        """What each of some images shows.

        Args:
            images: files of any kind and size, which are turned upright, scaled to cover the network's images and
                cropped at the centre; or arrays of bytes that have the size of the network's images.

        Raises:
            UserError: a file cannot be read, an array has another shape, or the network answers with what is no number.
        """
        found: list[Classified] = []
        for start in range(0, len(images), BATCH):
            stacked = np.stack([self._pixels(image) for image in images[start : start + BATCH]])
            rows = self.probabilities(torch.from_numpy(stacked.transpose(0, 3, 1, 2).copy()))
            found += [Classified(dict(zip(self.spec.classes, row, strict=True))) for row in rows.tolist()]
        return found

    @torch.no_grad()
    def probabilities(self, images: UInt8[Tensor, "b c h w"]) -> Float32[Tensor, "b k"]:
        """Probabilities of the classes for images of bytes.

        Raises:
            UserError: the network answers with what is no number.
        """
        device = next(self.network.parameters()).device
        found: Tensor = self.network(images.to(device).float() / 255).softmax(1).cpu()
        if bool(found.isnan().any()):
            raise UserError(
                f"the model in {self.name} answers with what is no number",
                "Its weights are damaged, or its training diverged. Take another checkpoint.",
            )
        return found

    def _pixels(self, image: Path | str | ndarray) -> UInt8[ndarray, "h w c"]:
        height, width, channels = self.spec.height, self.spec.width, self.spec.channels
        if isinstance(image, Path | str):
            if height != width:
                raise UserError(
                    f"{self.name} takes images of {height}x{width}; only square ones are cropped to fit",
                    f"Give arrays of bytes of {height}x{width} pixels.",
                )
            image = decode_square(Path(image).expanduser(), height, channels)
        return checked_pixels(np.asarray(image), (height, width, channels))
