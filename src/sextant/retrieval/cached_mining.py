"""Mining of hard negatives in the whole training set, by descriptors that were computed some steps ago."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.ranges import Count, checked
from sextant.retrieval.relations import Places, Tolerance, relations
from sextant.retrieval.triplet_mining import Mined, draw_column

Positive = Literal["nearest", "random", "furthest"]

#: Pairs that are considered at a time: a few tens of megabytes.
BLOCK = 2**20


@checked
@dataclass(frozen=True)
class CachedHardMining:
    """For each of some anchors, the nearest negatives among a sample of the training set.

    The caller keeps the cache: descriptors of all training images, in their order, recomputed every ``refresh`` steps.
    Triplets are indices into the training set; :func:`~sextant.retrieval.gathered` makes a batch of them.

    Args:
        refresh: training steps between two computations of the cache; read by the caller.
        anchors: number of anchors, drawn from the training set each time.
        candidates: number of images among which negatives are sought, drawn anew each time for all anchors together.
        negatives: number of negatives per anchor; fewer if fewer candidates are negatives of it.
        positive: which positive of the whole training set is taken, by the cached descriptors.

    Raises:
        UserError: a count is below 1, or ``positive`` is unknown.
    """

    refresh: Count = 100
    anchors: Count = 1000
    candidates: Count = 1000
    negatives: Count = 10
    positive: Positive = "nearest"

    @torch.no_grad()
    def __call__(
        self,
        cache: Float[Tensor, "n d"],
        places: Places,
        tolerance: Tolerance,
        generator: torch.Generator | None = None,
    ) -> Mined:
        """Triplets of indices into the training set, for each anchor from the hardest negative to the easiest.

        ``unusable`` counts anchors without a positive in the training set or without a negative among the candidates.

        Args:
            cache: descriptors of the training set.
            places: places of the same images, on the same device.
            tolerance: separates positives from negatives.
            generator: a generator on the CPU.

        Raises:
            ValueError: cache and places differ in number, or a descriptor is not finite.
        """
        if len(cache) != len(places):
            raise ValueError(f"{len(cache)} cached descriptors of {len(places)} places")
        if not bool(cache.isfinite().all()):
            raise ValueError("a cached descriptor is not finite")
        cache = cache.to(torch.promote_types(cache.dtype, torch.float32))
        order = [torch.randperm(len(cache), generator=generator).to(cache.device) for _ in range(2)]
        anchors, candidates = order[0][: self.anchors], order[1][: self.candidates].sort().values
        rows = max(1, BLOCK // max(1, len(cache)))
        blocks = [
            self._block(cache, places, tolerance, some, candidates, generator)
            for some in anchors.split(rows)
            if len(some)
        ]
        triplets = torch.cat([torch.zeros(0, 3, dtype=torch.int64, device=cache.device), *blocks])
        return Mined(triplets, len(anchors), len(anchors) - len(torch.unique(triplets[:, 0])))

    def _block(
        self,
        cache: Float[Tensor, "n d"],
        places: Places,
        tolerance: Tolerance,
        anchors: Int64[Tensor, "m"],
        candidates: Int64[Tensor, "c"],
        generator: torch.Generator | None,
    ) -> Int64[Tensor, "t 3"]:
        positives = relations(places, tolerance, anchors).positive
        negatives = relations(places, tolerance, anchors, candidates).negative
        usable = positives.any(1) & negatives.any(1)
        anchors, positives, negatives = anchors[usable], positives[usable], negatives[usable]
        if self.positive == "random":
            chosen = draw_column(positives, generator)
        else:
            sign = 1.0 if self.positive == "nearest" else -1.0
            apart = sign * torch.cdist(cache[anchors], cache)
            chosen = apart.masked_fill(~positives, torch.inf).argmin(1)
        apart = torch.cdist(cache[anchors], cache[candidates]).masked_fill(~negatives, torch.inf)
        nearest = apart.topk(min(self.negatives, len(candidates)), dim=1, largest=False, sorted=True)
        real = nearest.values.isfinite()
        row = real.nonzero()[:, 0]
        return torch.stack([anchors[row], chosen[row], candidates[nearest.indices[real]]], 1)
