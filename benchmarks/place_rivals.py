"""Descriptors not trained on pairs of images, for :mod:`benchmarks.unseen_places`.

Training-free ones at 32x64 pixels; whitened principal components of the map's pixels, 128 or fewer; stages of an
ImageNet network (EfficientNet-Lite0, images of 128x192, bfloat16) pooled by mean, generalised mean or over 4x6 cells,
raw and whitened by 128 principal components of the map; NetVLAD over 32 centres that k-means finds in the map.
"""

from collections.abc import Iterator

import numpy as np
import torch
import torch.nn.functional as F
from numpy import ndarray
from torch import Tensor

from benchmarks.place_sets import ImageSet, PlaceSet, in_batches
from sextant.baselines import Hog, PatchNormalised, Pixels, WhitenedPCA
from sextant.baselines.learned_projections import whitening
from sextant.baselines.place_descriptors import unit_norm
from sextant.models import EfficientNetLite0
from sextant.models.pooling import NetVLAD, generalised_mean

SMALL, LARGE = (32, 64), (128, 192)
STAGES, VLAD_STAGE = (3, 4, 5, 6, 7, 8), 5
COMPONENTS, CENTRES = 128, 32


def rivals(images: ImageSet) -> Iterator[tuple[str, PlaceSet]]:
    """Each method's name and descriptors of a set."""
    maps, queries = images.read(*SMALL)
    for name, method in (
        ("pixels", Pixels(*SMALL)),
        ("patch-normalised pixels", PatchNormalised(*SMALL)),
        ("HOG", Hog(*SMALL)),
        ("whitened PCA of pixels", WhitenedPCA(*SMALL).fit(maps)),
    ):
        yield name, _set(images, method.describe(maps), method.describe(queries))
    features = _trunk(*images.read(*LARGE))
    for name, (reference, query) in features.items():
        if name == "cells":
            continue
        yield name, _set(images, reference, query)
        if "stage 4" in name or "stage 6" in name:
            pca = whitening(reference, min(COMPONENTS, len(reference) - 1, reference.shape[1]))
            yield f"{name}, whitened", _set(images, *(pca.transform(part) for part in (reference, query)))
    yield f"stage {VLAD_STAGE}, NetVLAD", _set(images, *_vlad(*features["cells"]))


def _set(images: ImageSet, reference: ndarray, query: ndarray) -> PlaceSet:
    rows = (unit_norm(np.asarray(part, np.float32)) for part in (reference, query))
    return PlaceSet(images.name, images.family, *rows, images.positives)


@torch.no_grad()
def _trunk(maps: ndarray, queries: ndarray) -> dict[str, tuple[ndarray, ndarray]]:
    """The pooled maps of each stage; ``cells``: the unpooled ones of one stage."""
    network = EfficientNetLite0(3, LARGE, 1, weights="imagenet").eval().to(torch.bfloat16)
    network = network.to(memory_format=torch.channels_last)
    names: list[tuple[str, int]] = []

    def pooled(images: ndarray) -> ndarray:
        x = torch.from_numpy(images).permute(0, 3, 1, 2).to(torch.bfloat16) / 255
        x = network.stem(network.normalize(x).contiguous(memory_format=torch.channels_last))
        parts: list[tuple[str, Tensor]] = []
        for number, stage in enumerate(network.stages, start=1):
            x = stage(x)
            if number in STAGES:
                wide = x.float()
                parts.append((f"stage {number}, mean", wide.mean((2, 3))))
                parts.append((f"stage {number}, GeM", generalised_mean(wide, 3.0)))
                parts.append((f"stage {number}, 4x6 cells", F.adaptive_avg_pool2d(wide, (4, 6)).flatten(1)))
            if number == VLAD_STAGE:
                parts.append(("cells", x.float().flatten(1)))
        names[:] = [(name, part.shape[1]) for name, part in parts]
        return torch.cat([part for _, part in parts], 1).numpy()

    rows = [in_batches(pooled, images) for images in (maps, queries)]
    ends = np.cumsum([width for _, width in names])[:-1]
    split = [np.split(part, ends, axis=1) for part in rows]
    return {name: (a, b) for (name, _), a, b in zip(names, *split, strict=True)}


def _vlad(maps: ndarray, queries: ndarray) -> tuple[ndarray, ndarray]:
    size = LARGE[0] // 16, LARGE[1] // 16
    channels = maps.shape[1] // (size[0] * size[1])
    as_maps = [torch.from_numpy(part).view(-1, channels, *size) for part in (maps, queries)]
    cells = as_maps[0].flatten(2).transpose(1, 2).flatten(0, 1)
    pooling = NetVLAD(channels, size, clusters=CENTRES)
    pooling.initialise(cells[torch.randperm(len(cells), generator=torch.Generator().manual_seed(0))[:10_000]])
    with torch.no_grad():
        first, second = (pooling(part).numpy() for part in as_maps)
    return first, second
