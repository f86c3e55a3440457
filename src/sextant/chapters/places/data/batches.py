"""Batches of images of places, and batches of places for training, each a function of (seed, epoch)."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from sextant.chapters.places.data.augmentation import PlaceAugmentation
from sextant.chapters.places.data.images import PlaceImages, pairs_of
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.data.batches import StoredImages
from sextant.data.share import WHOLE, Share
from sextant.errors import ArgumentError
from sextant.retrieval import Places

#: how far ahead places that are far apart are searched for, in batches of places
LOOKAHEAD = 16


@dataclass(frozen=True)
class PlaceBatch(StoredImages):
    """A batch of images with the place of each.

    Attributes:
        images: bytes, ``(b, c, h, w)``, channels last in memory; if processes share a batch, only this process's share.
        position_m: x and y in metres, float64 (UTM coordinates need it), or None.
        heading_deg: in degrees, float64, or None.
        frame: frame number along the traverse.
        condition: number of the traverse.
        rows: indices of the images in their split.
        indices: numbers of the images, which seed corruptions: the row, and in training a new number in every epoch.
    """

    images: UInt8[Tensor, "b c h w"]
    position_m: Float64[Tensor, "b 2"] | None
    heading_deg: Float64[Tensor, "b"] | None
    frame: Int64[Tensor, "b"]
    condition: Int64[Tensor, "b"]
    rows: Int64[Tensor, "b"]
    indices: Int64[Tensor, "b"]


class PlaceBatchImages(Dataset[PlaceBatch]):
    """Images read a whole batch at a time: ``dataset[[3, 1, 4]]`` is one batch of three.

    Number ``i`` is image ``i % n``, with n images.

    Args:
        places: the images.
        augmentation: changes the images; None leaves them as they are.
        seed: of the augmentation.
        share: of the images that this process reads; poses are given for all images.
    """

    def __init__(
        self,
        places: PlaceImages,
        augmentation: PlaceAugmentation | None = None,
        seed: int = 0,
        share: Share = WHOLE,
    ):
        self.places, self.augmentation, self.seed, self.share = places, augmentation, seed, share

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, numbers: list[int] | Tensor) -> PlaceBatch:
        chosen = np.asarray(numbers, np.int64)
        rows = chosen % len(self.places)

        def part(column: ndarray | None) -> Tensor | None:
            return None if column is None else torch.from_numpy(column[rows])

        return PlaceBatch(
            self._images(self.share.of(chosen) if self.share.rank < len(chosen) else chosen[:1]),
            part(self.places.position_m),
            part(self.places.heading_deg),
            torch.from_numpy(self.places.frame[rows]),
            torch.from_numpy(self.places.traverse[rows]),
            torch.from_numpy(rows),
            torch.from_numpy(chosen),
        )

    def _images(self, chosen: Int64[ndarray, "b"]) -> UInt8[Tensor, "b c h w"]:
        images = torch.from_numpy(self.places.images[chosen % len(self.places)]).permute(0, 3, 1, 2)
        if self.augmentation is not None:
            images = self.augmentation(images, chosen, self.seed)
            if self.augmentation.mirror:  # whole epochs, so that no batch holds a place beside its mirror image
                mirrored = torch.from_numpy(chosen // len(self.places) % 2 == 1)
                images[mirrored] = images[mirrored].flip(-1)
        return images


class PlaceBatches(Sampler[Tensor]):
    """Batches of P places under C conditions each.

    *Places* are images of the first traverse, and those of further traverses that are at none of the previous places:
    about 1,600 for a traverse of 1,600 frames, however many seasons there are. A place without any positive is left
    out. An epoch shuffles the places and makes ``places // P`` batches of P of them, at least one; the remainder, fewer
    than P, is left out of that epoch.

    The places of a batch are at least the negative tolerance apart, so that images of two places are negatives. If no
    such place is left near the head of the order, a nearer one is taken; pairs in the ring between the tolerances are
    ignored.

    The images of a place are positives of one another: up to C images of different traverses. They are drawn from
    all within the tolerance. A place in fewer than C traverses is filled up with further images of these; one with
    fewer than C images contributes all that fit.

    A batch is a function of (seed, epoch, its number). It yields the number ``row + epoch * n`` for each image.

    Args:
        places: images with their places.
        tolerance: within which images show the same place.
        batch_places: P, places in a batch.
        batch_conditions: C, images of each place, at least 2.
        seed: of the order and the choice of images.

    Raises:
        UserError: no image has a positive, or the tolerance does not fit the way places are known.
        ValueError: P is below 1 or C below 2.
    """

    def __init__(
        self, places: PlaceImages, tolerance: PlaceTolerance, batch_places: int, batch_conditions: int, seed: int
    ):
        if batch_places < 1 or batch_conditions < 2:
            raise ValueError(f"a batch needs a place with at least two images, got {batch_places} x {batch_conditions}")
        self.batch_places, self.batch_conditions = batch_places, batch_conditions
        self.seed, self.epoch = seed, 0
        self._places, self._count = places, len(places)
        every = np.arange(len(places))
        self._positives = places.positives(every, every, tolerance)
        self.anchors = self._cover()
        if not len(self.anchors):
            raise ArgumentError(
                f"no training image has another within the tolerance of {tolerance.name}: nothing to learn from",
                f"Add traverses of the same places, or widen it: tolerance.{tolerance.unit}.positive=<more>",
                of=self,
            )
        self._near = places.not_negatives(self.anchors, self.anchors, tolerance)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch; the trainer calls this before each."""
        self.epoch = epoch

    def __len__(self) -> int:
        return max(1, len(self.anchors) // self.batch_places)

    def __iter__(self) -> Iterator[Tensor]:
        epoch = self.epoch
        for number, anchors in enumerate(self.places_of_epoch(epoch)):
            rng = np.random.default_rng([self.seed, epoch, number])
            rows = np.concatenate([self._images_of(anchor, rng) for anchor in anchors])
            yield torch.from_numpy(rows + epoch * self._count)

    def places_of_epoch(self, epoch: int) -> Iterator[Int64[ndarray, "p"]]:
        """The places of every batch of an epoch, as rows of images."""
        order = deque(np.random.default_rng([self.seed, epoch]).permutation(len(self.anchors)).tolist())
        for _ in range(len(self)):
            blocked = set[int]()
            taken: list[int] = []
            deferred: list[int] = []
            while order and len(taken) < self.batch_places and len(deferred) < LOOKAHEAD * self.batch_places:
                place = order.popleft()
                if place in blocked:
                    deferred.append(place)
                else:
                    taken.append(place)
                    blocked.update(pairs_of(self._near, place).tolist())
            lacking = self.batch_places - len(taken)
            taken, deferred = taken + deferred[:lacking], deferred[lacking:]
            order.extendleft(reversed(deferred))
            yield self.anchors[taken]

    def _cover(self) -> Int64[ndarray, "a"]:
        """Anchors, traverse by traverse: every image with a positive is an anchor or a positive of one."""
        lonely = np.diff(self._positives.indptr) == 0
        covered, anchors = lonely.copy(), []
        for traverse in range(len(self._places.conditions)):
            rows = np.flatnonzero(~covered & (self._places.traverse == traverse))
            anchors.append(rows)
            covered[rows] = True
            covered[self._positives[rows].indices] = True
        return np.concatenate(anchors)

    def _images_of(self, anchor: int, rng: np.random.Generator) -> Int64[ndarray, "k"]:
        """Distinct images of one place, each a positive of all others."""
        candidates = np.union1d(pairs_of(self._positives, anchor), [anchor]).astype(np.int64)
        traverses = self._places.traverse[candidates]
        chosen: list[int] = []
        for traverse in rng.permutation(np.unique(traverses)):
            self._choose(chosen, candidates[traverses == traverse], rng)
            if len(chosen) == self.batch_conditions:
                return np.array(chosen)
        while len(chosen) < self.batch_conditions and self._choose(chosen, candidates, rng):
            pass
        return np.array(chosen)

    def _choose(self, chosen: list[int], candidates: ndarray, rng: np.random.Generator) -> bool:
        """Add one of the candidates that are positives of all chosen images, if there is one."""
        for image in chosen:
            candidates = np.intersect1d(candidates, pairs_of(self._positives, image), assume_unique=True)
        if not len(candidates):
            return False
        chosen.append(int(rng.choice(candidates)))
        return True


def batch_places(batch: PlaceBatch, tolerance: PlaceTolerance) -> Places:
    """Where the images of a batch were taken, in the tolerance's unit."""
    position = batch.position_m if tolerance.unit == "m" else batch.frame[:, None]
    assert position is not None  # the data module read it with this tolerance
    return Places(position, None if tolerance.heading_deg is None else batch.heading_deg)


def places_of(images: PlaceImages, tolerance: PlaceTolerance) -> Places:
    """Where the images of a split were taken, in the tolerance's unit."""
    position = images.position_m if tolerance.unit == "m" else images.frame[:, None]
    assert position is not None
    known = tolerance.heading_deg is not None and images.heading_deg is not None
    heading = torch.from_numpy(images.heading_deg) if known else None
    return Places(torch.from_numpy(position), heading)
