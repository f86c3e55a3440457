"""Which places of a drive are scenes: far enough apart, seen under every condition, and no place twice."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.tolerance import PlaceTolerance

#: a spacing is too small if more than this share of scenes lie too close to the one before
CROWDED = 0.1


@dataclass(frozen=True, eq=False)
class LaidScenes:
    """Scenes as rows of a split's images.

    Attributes:
        centres: the image of each scene under each condition, references first.
        examples: training images of each scene.
        left_out: places that are not scenes, each with the reason.
    """

    centres: Int64[ndarray, "s c"]
    examples: list[Int64[ndarray, "_"]]
    left_out: tuple[str, ...]

    @property
    def labels_of_examples(self) -> Int64[ndarray, "n"]:
        """The scene of each training image."""
        return np.repeat(np.arange(len(self.examples)), [len(rows) for rows in self.examples])


class SceneDrive:
    """The places along the drive under the first reference condition, with the images of each under every condition.

    Args:
        images: of a split.
        references: conditions of training images.
        queries: conditions of test images.
        neighbours: number of frames to either side that are training images too.
        tolerance: within which images show the same place.

    Attributes:
        along: the images of the drive.
    """

    def __init__(
        self,
        images: PlaceImages,
        references: tuple[str, ...],
        queries: tuple[str, ...],
        neighbours: int,
        tolerance: PlaceTolerance,
    ):
        self.images, self.neighbours, self.tolerance = images, neighbours, tolerance
        self.names, self.references = (*references, *queries), len(references)
        self.along = images.rows_of(references[0])
        self.at = {(int(t), int(f)): row for row, (t, f) in enumerate(zip(images.traverse, images.frame, strict=True))}
        self.centres = np.stack([self._counterparts(images.rows_of(name)) for name in self.names], 1)

    def lay_out(self, spacing: int) -> LaidScenes | None:
        """Lay out scenes ``spacing`` frames apart; None if too many are too close to the one before."""
        chosen = np.arange(self.neighbours, len(self.along) - self.neighbours, spacing)
        left_out, complete = [], []
        for index in chosen.tolist():
            lacking = [name for name, row in zip(self.names, self.centres[index], strict=True) if row < 0]
            if lacking:
                left_out.append(f"{self._name(index)} has no image under {', '.join(lacking)}")
            else:
                complete.append(index)
        examples = [self._examples(index) for index in complete]
        near = self._near(complete, examples)
        if np.trace(near, offset=1) > CROWDED * (len(complete) - 1):
            return None
        kept: list[int] = []
        for i in range(len(complete)):
            earlier = [k for k in kept if near[i, k]]
            if earlier:
                left_out.append(f"{self._name(complete[i])} is the place of {self._name(complete[earlier[0]])}")
            else:
                kept.append(i)
        rows = np.array([complete[i] for i in kept], np.int64)
        return LaidScenes(self.centres[rows], [examples[i] for i in kept], tuple(left_out))

    def _name(self, index: int) -> str:
        return self.images.names[int(self.along[index])]

    def _counterparts(self, rows: Int64[ndarray, "k"]) -> Int64[ndarray, "n"]:
        """For each place of the drive, its image among ``rows`` of a traverse; -1 if there is none."""
        images, along = self.images, self.along
        if not len(rows) or images.traverse[rows[0]] == images.traverse[along[0]]:
            return along if len(rows) else np.full(len(along), -1)
        if images.aligned:
            traverse = int(images.traverse[rows[0]])
            return np.array([self.at.get((traverse, int(frame)), -1) for frame in images.frame[along]])
        assert images.position_m is not None  # else they would be aligned
        pairs = images.positives(along, rows, self.tolerance)
        found = np.full(len(along), -1)
        for place, row in enumerate(along):
            near = rows[pairs.indices[pairs.indptr[place] : pairs.indptr[place + 1]]]
            if len(near):
                apart = np.hypot(*(images.position_m[near] - images.position_m[row]).T)
                found[place] = near[apart.argmin()]
        return found

    def _examples(self, index: int) -> Int64[ndarray, "_"]:
        """Training images of the scene at a place."""
        rows = []
        for centre in self.centres[index, : self.references]:
            traverse, frame = int(self.images.traverse[centre]), int(self.images.frame[centre])
            around = range(frame - self.neighbours, frame + self.neighbours + 1)
            rows += [self.at[traverse, f] for f in around if (traverse, f) in self.at]
        return np.array(rows, np.int64)

    def _near(self, places: list[int], examples: list[Int64[ndarray, "_"]]) -> Bool[ndarray, "s s"]:
        """Whether an image of one scene is at the place of another, symmetric."""
        near = np.zeros((len(places), len(places)), bool)
        if not places:
            return near
        centres = self.centres[places]
        scene_of_example = np.repeat(np.arange(len(places)), [len(rows) for rows in examples])
        pairs = self.images.positives(centres.ravel(), np.concatenate(examples), self.tolerance)
        first = np.repeat(np.repeat(np.arange(len(places)), centres.shape[1]), np.diff(pairs.indptr))
        near[first, scene_of_example[pairs.indices]] = True
        return (near | near.T) & ~np.eye(len(places), dtype=bool)
