"""Finding in images what one or several examples show."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import torch
from annotated_types import Ge
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.applications.arguments import check_kind, check_share
from sextant.chapters.cosfire.detector_options import LONGEST, MAX_DETECTIONS, PHOTO, check_point
from sextant.chapters.cosfire.filters import REACH, network_filter, preset_filter, tolerant
from sextant.chapters.cosfire.images import AnyImage, UprightImage, upright_image
from sextant.chapters.cosfire.network_image import TrainedFeatures, trained_features
from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire import Cosfire, Move, keypoints
from sextant.ranges import Count, Positive, checked
from sextant.runs.outputs_folder import default_outputs

#: default threshold of the score, for hand-made filters and for features of a network, whose cosines are seldom small
THRESHOLD, NETWORK_THRESHOLD = 0.7, 0.8


@dataclass(frozen=True)
class Detection:
    """A detection.

    Attributes:
        x, y: position in pixels of the upright original, whose centres are at whole numbers.
        score: the response as a share of the filter's response to its own prototype.
        move: the move of the example that responds most strongly; None if the filter tolerates none.
        example: number of that example, in the order of adding.
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
    """An example that a filter was configured from.

    Attributes:
        image: the image of the example.
        point: x and y of what is looked for, in the image's picture.
        parts: number of parts of the filter as the example shows them.
        radius: largest distance of a part from the centre, in pixels of the maps, at least one.
        own: the filter's strongest response at the point, or within the distance by which parts may be off.
        moves: moves of the filter's forms; None for a form whose move is unknown, or if there is only one.
    """

    image: UprightImage
    point: tuple[float, float]
    parts: int
    radius: float
    own: float
    moves: tuple[Move | None, ...]


@checked
class ExampleDetector:
    """Finds what an example shows, wherever the same parts are arranged alike: a COSFIRE filter, without training.

    The filter operates on Gabor filters, or on the features of a trained network, see :meth:`load`. Several examples
    have a filter each, and the strongest response counts. Images are files of any kind or Pillow images, turned upright
    by EXIF, or upright arrays of bytes, grey or RGB.

    >>> detector = ExampleDetector(rotations=8).add("photo.jpg", point=(310, 190))  # doctest: +SKIP
    >>> for found in detector.detect("other.jpg"):  # doctest: +SKIP
    ...     print(found.x, found.y, found.score)

    Args:
        features: features of a network for the filters to operate on; otherwise those that ``preset`` names.
        preset: constants of published filters, or ``photo`` (edges) by default; one of
            :data:`~sextant.chapters.cosfire.detector_options.PRESET_NAMES`.
        rotations: number of orientations of an example to find, evenly spaced over the circle; by default the preset's,
            or 1.
        scales: sizes of an example to find, such as ``(0.7, 1, 1.4)``; by default the preset's, or 1.
        reflection: find mirror images too; by default as the preset says, or not.
        longest: images larger than this, including examples, are shrunk to this longest side in pixels.
        reach: distance in pixels from the centre of a ``photo`` filter to its outermost parts: half an object's size.

    Attributes:
        filters: every form of a filter, i.e. one move of its example, as a separate filter.
        examples: examples that were added.
        threshold: least score of a detection, unless another is given.

    Raises:
        ArgumentError: there is no such preset, or it was given together with features; ``features`` are none; there is
            no rotation, a scale is not above 0, ``longest`` is below 16, or ``reach`` below 8.
    """

    def __init__(
        self,
        features: TrainedFeatures | None = None,
        *,
        preset: str | None = None,
        rotations: Count | None = None,
        scales: Sequence[Positive] | None = None,
        reflection: Literal[True, False] | None = None,
        longest: Annotated[int, Ge(16)] = LONGEST,
        reach: Positive = REACH,
    ):
        check_kind("features", features, TrainedFeatures, "Those of a network: ExampleDetector.load(run)")
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
        """A detector on the network of a classification or place-recognition run.

        Args:
            run: an MLflow run id, a run directory or its name, a checkpoint, or a published ``.pth.tar``.
            outputs: folder of runs; the folder that runs are written to by default.
            layer: layer whose output is used; by default the one that place descriptors are made of, or a classifier's
                last feature map.
            trust: build user-defined parts that the checkpoint names.
            chosen: as for the class.

        Raises:
            UserError: there is no such run or layer, its file is damaged, or it is of another task.
        """
        folder = default_outputs() if outputs is None else Path(outputs).expanduser()
        return cls(trained_features(str(run), folder, layer, trust=trust), **chosen)

    @torch.no_grad()
    def add(self, example: AnyImage | UprightImage, point: tuple[float, float] | None = None) -> Self:
        """Add an example of what to look for.

        Args:
            example: an image.
            point: x and y of what is looked for, in pixels of the upright original; None is the centre.

        Raises:
            UserError: the image cannot be read, or has nothing at the point to configure a filter from.
            ArgumentError: the point is not two numbers, or lies outside the image.
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
                f"the filter does not respond to its own prototype at x {at[0]:.0f}, y {at[1]:.0f}",
                "Choose a point further from the border of the prototype.",
            )
        # a bank that cannot steer may have found nothing in some moved examples; which ones is then unknown
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
        """Detect in an image; the strongest detections come first.

        Args:
            image: a file, a Pillow image, or an array of bytes.
            threshold: least score; :attr:`threshold` unless given.
            min_distance: distance within which two detections are merged, in pixels of the original; the filter's
                radius unless given.
            max_detections: largest number of detections; the strongest are kept.

        Raises:
            UserError: there is no example yet, the image cannot be read, or the network cannot take it.
            ArgumentError: an option is outside its range.
        """
        return self.find(
            upright_image(image, self.longest),
            threshold=threshold,
            min_distance=min_distance,
            max_detections=max_detections,
        )[1]

    @checked
    def find(
        self,
        image: UprightImage,
        *,
        threshold: float | None = None,
        min_distance: Positive | None = None,
        max_detections: Count = MAX_DETECTIONS,
    ) -> tuple[Float[ndarray, "y x"], list[Detection]]:
        """The response over an image, and the detections as for :meth:`detect`.

        Raises:
            UserError: there is no example yet, or the network cannot take the image.
            ArgumentError: an option is outside its range.
        """
        response, form = self.respond(image.tensor(self.channels))
        across, down = image.width / response.shape[1], image.height / response.shape[0]
        least = self.threshold if threshold is None else threshold
        check_share("threshold", least, "For example threshold=0.7")
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
        """The strongest response over all forms, as a share of its example's own, and the number of that form.

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
        """The strongest response to each example in vertical strips of images, as a share of its own response.

        Args:
            images: images in [0, 1], of one size.
            columns: number of strips, from left to right.

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
