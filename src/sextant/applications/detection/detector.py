"""What an example shows, or several, found in images."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.applications.detection.filters import REACH, network_filter, preset_filter, tolerant
from sextant.applications.detection.images import AnyImage, UprightImage, upright_image
from sextant.applications.detection.network import TrainedFeatures, trained_features
from sextant.applications.detection.options import LONGEST, MAX_DETECTIONS, PHOTO, check_point
from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire import Cosfire, Move, keypoints
from sextant.runs.outputs_folder import default_outputs

#: least score, with filters made by hand and with features of a network: cosines are seldom small
THRESHOLD, NETWORK_THRESHOLD = 0.7, 0.8


@dataclass(frozen=True)
class Detection:
    """Something found.

    Attributes:
        x, y: in pixels of the upright original, whose centres are at whole numbers.
        score: the response, as a share of what the filter answers to its own prototype.
        move: of the example that answers most; None where the filter tolerates none.
        example: which one that is, in the order in which they were added.
    """

    x: float
    y: float
    score: float
    move: Move | None
    example: int = 0

    def row(self) -> dict[str, Any]:
        """Plain values."""
        row: dict[str, Any] = {"x": round(self.x, 1), "y": round(self.y, 1), "score": round(self.score, 4)}
        if self.move is not None:
            turn = round(float(np.degrees(self.move.rotation_rad)), 2)
            row |= {"rotation_deg": turn, "scale": self.move.scale, "mirrored": self.move.mirrored}
        return row


@dataclass(frozen=True)
class Example:
    """What a filter was configured from.

    Attributes:
        image: see there.
        point: of what is looked for, x and y in the image's picture.
        parts: of the filter as the example shows them.
        radius: largest distance of a part from the centre, in pixels of the maps, at least one.
        own: the strongest response of the filter at the point, and as near to it as parts may be off.
        moves: of the filter's forms; None for a form whose move is not known, or where there is but one.
    """

    image: UprightImage
    point: tuple[float, float]
    parts: int
    radius: float
    own: float
    moves: tuple[Move | None, ...]


class ExampleDetector:
    """Finds what an example shows, wherever the same parts are arranged alike: a COSFIRE filter, not trained.

    It looks through Gabor filters, or through the features of a trained network, see :meth:`load`. Several examples
    have a filter each, and the one that answers most counts. Images are files of any kind, turned upright by EXIF, or
    upright arrays of bytes, grey or RGB.

    >>> detector = ExampleDetector(rotations=8).add("photo.jpg", point=(310, 190))  # doctest: +SKIP
    >>> for found in detector.detect("other.jpg"):  # doctest: +SKIP
    ...     print(found.x, found.y, found.score)

    Args:
        features: of a network that filters look through; without them it is what ``preset`` says.
        preset: constants of published filters, or ``photo`` (edges) by default; one of
            :data:`~sextant.applications.detection.options.PRESET_NAMES`.
        rotations: of an example that are found too, evenly over the circle; the preset's, or 1.
        scales: sizes of an example that are found too, such as ``(0.7, 1, 1.4)``; the preset's, or 1.
        reflection: mirror images are found too; as the preset says, or not.
        longest: pixels of the longest side that larger images, examples too, are shrunk to.
        reach: pixels from the centre of a filter of ``photo`` to its outermost parts: half the size of a thing.

    Attributes:
        filters: each form of a filter, which is one move of its example, as a filter of its own.
        examples: that were added.
        threshold: least score of a detection, unless another is given.

    Raises:
        ArgumentError: there is no such preset, or features have none; no rotation, or a scale that is not above 0.
    """

    def __init__(
        self,
        features: TrainedFeatures | None = None,
        *,
        preset: str | None = None,
        rotations: int | None = None,
        scales: Sequence[float] | None = None,
        reflection: bool | None = None,
        longest: int = LONGEST,
        reach: float = REACH,
    ):
        if features is None:
            filters, self.channels, self.threshold = preset_filter(preset or PHOTO, reach), 1, THRESHOLD
        elif preset is None:
            filters, self.channels = network_filter(features.features, features.size), features.channels
            self.threshold = NETWORK_THRESHOLD
        else:
            raise ArgumentError(f"preset={preset} does not go with features of a network", "Leave one of them out.")
        self.filters: Cosfire = tolerant(filters, rotations, scales, reflection)
        self.longest = longest
        self.examples: list[Example] = []

    @classmethod
    def load(
        cls,
        run: Path | str,
        outputs: Path | str | None = None,
        *,
        layer: str | None = None,
        trust: bool = False,
        **chosen: Any,
    ) -> Self:
        """A detector that looks through the network of a run of classification or place recognition.

        Args:
            run: an MLflow run id, a run directory or its name, a checkpoint, or a published ``.pth.tar``.
            outputs: folder of runs; where runs are written unless given.
            layer: whose output is looked at; that which descriptors of places are made of, or a classifier's last map.
            trust: build parts of the user's own that the checkpoint names.
            chosen: as for the class.

        Raises:
            UserError: there is no such run or layer, its file is damaged, or it is one of another task.
        """
        folder = default_outputs() if outputs is None else Path(outputs).expanduser()
        return cls(trained_features(str(run), folder, layer, trust=trust), **chosen)

    @torch.no_grad()
    def add(self, example: AnyImage | UprightImage, point: tuple[float, float] | None = None) -> Self:
        """Look for what an example shows, too.

        Args:
            example: an image.
            point: x and y of what is looked for, in pixels of the upright original; None is the middle.

        Raises:
            UserError: the image cannot be read, or has nothing at the point that a filter could be made of.
        """
        image = upright_image(example, self.longest)
        if point is not None:
            check_point(point, (image.width, image.height))
        before = self.filters.state_dict()
        try:
            self.examples.append(self._configured(image, point))
        except UserError as error:
            self.filters.load_state_dict(before)
            height, width = image.picture.shape[:2]
            where = "" if image.scale == 1 else f" (shrunk to {width}x{height} pixels)"
            raise UserError(f"{image.name}{where}: {error.problem}", error.fix) from None
        return self

    def _configured(self, image: UprightImage, point: tuple[float, float] | None) -> Example:
        filters, tensor, first = self.filters, image.tensor(self.channels), len(self.filters.filter_of_form)
        height, width = tensor.shape[1:]
        at = (width // 2, height // 2) if point is None else image.at(point)
        filters.configure(tensor, at)
        forms, moves = len(filters.filter_of_form) - first, tuple(filters.tolerance.moves())
        filters.load_state_dict(filters.state_dict() | {"filter_of_form": torch.arange(first + forms)})
        rho = filters.tuples(first).rho
        radius = max(1.0, float(rho.max()))
        response = filters(tensor[None])[0, first:].amax(0)
        row = int((at[1] + 0.5) * response.shape[0] / height)
        column = int((at[0] + 0.5) * response.shape[1] / width)
        reach = math.ceil(filters.blur.sigma0 + filters.blur.alpha * radius)
        top, left = max(0, row - reach), max(0, column - reach)
        own = float(response[top : row + reach + 1, left : column + reach + 1].max())
        if not own > 0:
            raise UserError(
                f"the filter does not answer to its own prototype at x {at[0]:.0f}, y {at[1]:.0f}",
                "Choose a point that is not so near the border of the prototype.",
            )
        # a bank that cannot steer may have found nothing in some moved examples, and then which is not known
        known = forms == len(moves) > 1
        return Example(image, at, len(rho), radius, own, moves if known else (None,) * forms)

    def detect(
        self,
        image: AnyImage,
        *,
        threshold: float | None = None,
        min_distance: float | None = None,
        max_detections: int = MAX_DETECTIONS,
    ) -> list[Detection]:
        """What is found in an image, the strongest first.

        Args:
            image: a file, or bytes.
            threshold: least score; :attr:`threshold` unless given.
            min_distance: within which two are one, in pixels of the original; the filter's radius unless given.
            max_detections: the strongest.

        Raises:
            UserError: there is no example yet, the image cannot be read, or the network cannot take it.
        """
        return self.find(
            upright_image(image, self.longest),
            threshold=threshold,
            min_distance=min_distance,
            max_detections=max_detections,
        )[1]

    def find(
        self,
        image: UprightImage,
        *,
        threshold: float | None = None,
        min_distance: float | None = None,
        max_detections: int = MAX_DETECTIONS,
    ) -> tuple[Float[ndarray, "y x"], list[Detection]]:
        """The response over an image, and what :meth:`detect` finds in it.

        Raises:
            UserError: there is no example yet, or the network cannot take the image.
        """
        response, form = self.respond(image.tensor(self.channels))
        across, down = image.width / response.shape[1], image.height / response.shape[0]
        least = self.threshold if threshold is None else threshold
        apart = self.radius if min_distance is None else min_distance / across
        forms = [(move, number) for number, example in enumerate(self.examples) for move in example.moves]
        found = [
            Detection(
                (point.x + 0.5) * across - 0.5,
                (point.y + 0.5) * down - 0.5,
                point.score,
                *forms[form[point.y, point.x]],
            )
            for point in keypoints(response, threshold=least, min_distance=apart)[:max_detections]
        ]
        return response.numpy(), found

    @property
    def radius(self) -> float:
        """Largest distance of a part from the centre of its filter, in pixels of the maps."""
        return max(example.radius for example in self.examples)

    @torch.no_grad()
    def respond(self, image: Float[Tensor, "c h w"]) -> tuple[Float[Tensor, "y x"], Int64[Tensor, "y x"]]:
        """The strongest response of all forms, each as a share of its example's own, and the number of the form.

        Raises:
            UserError: there is no example yet, or the network cannot take the image.
        """
        if not self.examples:
            raise UserError("there is no example yet of what to detect", "Call add(image, point) first.")
        response = self.filters(image[None])[0]
        own = torch.tensor([example.own for example in self.examples for _ in example.moves])
        best = (response / own.to(response)[:, None, None]).max(0)
        return best.values, best.indices

    @torch.no_grad()
    def strongest(self, images: Float[Tensor, "n c h w"], columns: int = 1) -> Float[Tensor, "n examples columns"]:
        """How strongly each example is answered in vertical strips of images, as a share of its own response.

        Args:
            images: in [0, 1], of one size.
            columns: strips, from left to right.

        Raises:
            UserError: there is no example yet, or the network cannot take the images.
        """
        if not self.examples:
            raise UserError("there is no example yet of what to detect", "Call add(image, point) first.")
        strips = torch.nn.functional.adaptive_max_pool2d(self.filters(images), (1, columns))[:, :, 0]
        parts = strips.split([len(example.moves) for example in self.examples], dim=1)
        return torch.stack(
            [part.amax(1) / example.own for part, example in zip(parts, self.examples, strict=True)], dim=1
        )
