"""Which examples filters are configured from, and at which points."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int64, UInt8
from torch import Tensor

from sextant.chapters.cosfire.representations import filter_maxima, images_at_once
from sextant.errors import UserError
from sextant.layers.cosfire import Cosfire

#: places that are tried if an example lacks structure
TRIES = 20


class NoFilterError(UserError):
    """No filter could be configured for a class."""


@dataclass(frozen=True)
class PrototypeSettings:
    """How prototypes are chosen.

    Attributes:
        per_class: filters per class; with fewer examples than that, each is used several times.
        at: ``random`` points, or the ``centre``.
        margin: random points keep this share of the image's sides from its border.
        least_parts: fewest parts of a filter; points that give fewer are skipped.
    """

    per_class: int = 10
    at: Literal["random", "centre"] = "random"
    margin: float = 0.15
    least_parts: int = 2


@dataclass(frozen=True)
class Prototypes:
    """The prototypes of filters.

    Attributes:
        labels: class of each filter.
        images: index of the example.
        points: x and y in the example.
    """

    labels: Int64[Tensor, "f"]
    images: Int64[Tensor, "f"]
    points: Float[Tensor, "f 2"]


def configure(
    filters: Cosfire,
    images: UInt8[Tensor, "n c h w"],
    labels: Int64[Tensor, "n"],
    settings: PrototypeSettings,
    generator: torch.Generator,
) -> Prototypes:
    """Configure ``settings.per_class`` filters for each class.

    Raises:
        NoFilterError: no example of a class has enough structure at any of the points tried.
    """
    chosen: list[tuple[int, int, float, float]] = []
    for label in torch.unique(labels).tolist():
        members = (labels == label).nonzero()[:, 0]
        order = members[torch.randperm(len(members), generator=generator)]
        chosen += [
            (label, *_configured(filters, images, label, order, turn, settings, generator))
            for turn in range(settings.per_class)
        ]
    number, image, x, y = (torch.tensor(column) for column in zip(*chosen, strict=True))
    return Prototypes(number, image, torch.stack([x, y], 1))


def own_responses(filters: Cosfire, images: UInt8[Tensor, "f c h w"]) -> Float[Tensor, "f"]:
    """The strongest response of filter i to image i, for all i."""
    # in batches, whose responses to all filters are in memory at a time; filters and images are in the same order
    rows = torch.arange(len(images)).split(images_at_once(filters, images))
    return torch.cat([filter_maxima(filters, images[own])[:, own].diagonal() for own in rows])


def _configured(
    filters: Cosfire,
    images: Tensor,
    label: int,
    order: Tensor,
    turn: int,
    settings: PrototypeSettings,
    generator: torch.Generator,
) -> tuple[int, float, float]:
    """Add a filter; returns its example and point."""
    height, width = images.shape[-2:]
    refused = ""
    tries = min(TRIES, len(order)) if settings.at == "centre" else TRIES
    for attempt in range(tries):
        # first other places in the same example, then other examples after half of the tries
        row = int(order[(turn + (attempt if settings.at == "centre" or attempt >= TRIES // 2 else 0)) % len(order)])
        point = ((width - 1) / 2, (height - 1) / 2)
        if settings.at == "random":
            share = settings.margin + (1 - 2 * settings.margin) * torch.rand(2, generator=generator)
            point = (float(share[0]) * (width - 1), float(share[1]) * (height - 1))
        try:
            filters.configure(images[row].to(filters.rho.device).float() / 255, point)
        except UserError as error:
            refused = f"; at the last place: {error.problem}"
            continue
        refused = ""
        if len(filters.tuples(len(filters) - 1)) >= settings.least_parts:
            return row, *point
        filters.drop_last()
    raise NoFilterError(
        f"no filter of at least task.least_parts={settings.least_parts} parts could be configured for "
        f"class {label} (counted from 0) in {tries} tries{refused}",
        "Lower task.least_parts, strategy.t2 or filters.t1, or choose smaller strategy.radii.",
    )
