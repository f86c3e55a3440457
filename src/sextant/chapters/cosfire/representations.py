"""Feature vectors of images: filter maxima, and those of a network's feature map without filters."""

from collections.abc import Callable
from typing import Literal

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from sextant.layers.cosfire import Cosfire
from sextant.reporter import Advance

#: most values of the maps of all parts of all filters that are in memory at a time
FLOATS_AT_ONCE = 2**22


def filter_maxima(
    filters: Cosfire, images: UInt8[Tensor, "n c h w"], show: Advance = lambda done, total: None, *, tiles: int = 1
) -> Float[Tensor, "n m"]:
    """The strongest response of each filter in each image, or in each of its tiles x tiles parts.

    Computed on the filters' device, returned on the CPU.
    """

    def described(batch: Tensor) -> Tensor:
        return filters.maxima(batch, tiles)

    return _in_batches(described, images, images_at_once(filters, images), filters.rho.device, show)


def feature_maps(
    features: nn.Module, images: UInt8[Tensor, "n c h w"], kind: Literal["full", "pooled"]
) -> Float[Tensor, "n d"]:
    """The rectified feature map of each image in full, or averaged over places; on the CPU."""

    def described(batch: Tensor) -> Tensor:
        maps: Tensor = features(batch).clamp(min=0)
        return maps.flatten(1) if kind == "full" else maps.mean((2, 3))

    weight = next(features.parameters(), None)
    return _in_batches(described, images, 64, torch.device("cpu") if weight is None else weight.device)


def images_at_once(filters: Cosfire, images: UInt8[Tensor, "n c h w"]) -> int:
    """Number of images per batch for which the maps of all parts fit into memory, 64 at most."""
    with torch.no_grad():
        one = images[:1].to(filters.rho.device).float() / 255
        map_size = filters.bank.describe(one).shape[-2:].numel()
    return min(64, max(1, FLOATS_AT_ONCE // (len(filters.rho) * map_size)))


def _in_batches(
    describe: Callable[[Tensor], Tensor],
    images: UInt8[Tensor, "n c h w"],
    batch: int,
    device: torch.device,
    show: Advance = lambda done, total: None,
) -> Tensor:
    found = []
    with torch.no_grad():
        for start in range(0, len(images), batch):
            found.append(describe(images[start : start + batch].to(device).float() / 255).cpu())
            show(min(start + batch, len(images)), len(images))
    return torch.cat(found)
