"""A filter configured from one example, and what it finds."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor

from sextant.applications.detection.images import UprightImage
from sextant.errors import UserError
from sextant.layers.cosfire import Cosfire, Move, keypoints


@dataclass(frozen=True)
class Detection:
    """Something found.

    Attributes:
        x, y: in pixels of the upright original, whose centres are at whole numbers.
        score: the response, as a share of what the filter answers to its own prototype.
        move: of the example that answers most; None where the filter tolerates none.
    """

    x: float
    y: float
    score: float
    move: Move | None

    def row(self) -> dict[str, Any]:
        """Plain values."""
        row: dict[str, Any] = {"x": round(self.x, 1), "y": round(self.y, 1), "score": round(self.score, 4)}
        if self.move is not None:
            turn = round(float(np.degrees(self.move.rotation_rad)), 2)
            row |= {"rotation_deg": turn, "scale": self.move.scale, "mirrored": self.move.mirrored}
        return row


class Detector:
    """Finds what an example shows.

    Args:
        filters: not configured; of :mod:`~sextant.applications.detection.filters`.
        prototype: the example.
        point: x and y of what is looked for, in pixels of the upright original; None is the middle.
        channels: of the images that the filter takes.

    Attributes:
        filters: each form of the filter, which is one move of the example, as a filter of its own; the example first.
        point: in the prototype's picture.
        own: the strongest response of the filter to its prototype at the point, and as near to it as parts may be off.
        moves: of the forms; None for a form whose move is not known, or where there is but one.

    Raises:
        UserError: the example has nothing at the point that a filter could be made of.
    """

    @torch.no_grad()
    def __init__(self, filters: Cosfire, prototype: UprightImage, point: tuple[float, float] | None, channels: int):
        self.channels = channels
        example = prototype.tensor(channels)
        height, width = example.shape[1:]
        self.point = (width // 2, height // 2) if point is None else prototype.at(point)
        filters.configure(example, self.point)
        forms, moves = len(filters.filter_of_form), list(filters.tolerance.moves())
        # a bank that cannot steer may have found nothing in some moved examples, and then which is not known
        known = forms == len(moves) > 1
        self.moves: list[Move | None] = [*moves] if known else [None] * forms
        filters.load_state_dict(filters.state_dict() | {"filter_of_form": torch.arange(forms)})
        self.filters, self.own = filters, 1.0
        response, _ = self.respond(example)
        row = int((self.point[1] + 0.5) * response.shape[0] / height)
        column = int((self.point[0] + 0.5) * response.shape[1] / width)
        reach = math.ceil(filters.blur.sigma0 + filters.blur.alpha * self.radius)
        top, left = max(0, row - reach), max(0, column - reach)
        self.own = float(response[top : row + reach + 1, left : column + reach + 1].max())
        if not self.own > 0:
            raise UserError(
                f"the filter does not answer to its own prototype at x {self.point[0]:.0f}, y {self.point[1]:.0f}",
                "Choose a point that is not so near the border of the prototype.",
            )

    @property
    def parts(self) -> int:
        """Parts of the filter as its prototype shows them."""
        return len(self.filters.tuples(0))

    @property
    def radius(self) -> float:
        """Largest distance of a part from the centre, in pixels of the maps, at least one."""
        return max(1.0, float(self.filters.tuples(0).rho.max()))

    @torch.no_grad()
    def respond(self, example: Float[Tensor, "c h w"]) -> tuple[Float[Tensor, "y x"], Int64[Tensor, "y x"]]:
        """The strongest response of all forms as a share of :attr:`own`, and the number of the form."""
        best = (self.filters(example[None])[0] / self.own).max(0)
        return best.values, best.indices

    def find(
        self, image: UprightImage, *, threshold: float, min_distance: float | None, most: int
    ) -> tuple[Float[ndarray, "y x"], list[Detection]]:
        """The response over an image and what is found in it, the strongest first.

        Args:
            image: see there.
            threshold: least score.
            min_distance: within which two are one, in pixels of the original; None is :attr:`radius` of the maps.
            most: detections.

        Raises:
            UserError: the network cannot take such an image.
        """
        response, form = self.respond(image.tensor(self.channels))
        across, down = image.width / response.shape[1], image.height / response.shape[0]
        apart = self.radius if min_distance is None else min_distance / across
        found = [
            Detection(
                (point.x + 0.5) * across - 0.5,
                (point.y + 0.5) * down - 0.5,
                point.score,
                self.moves[int(form[point.y, point.x])],
            )
            for point in keypoints(response, threshold=threshold, min_distance=apart)[:most]
        ]
        return response.numpy(), found
