"""Places as classes: recognise a scene, known from one image or many, under another condition."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.images import Split as PlaceSplit
from sextant.chapters.places.data.source import PlaceSource
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.data.source import ImageSource, ImageSpec, LabelledImages, Split, channels_first
from sextant.errors import UserError
from sextant.tables import counted

#: a spacing is too small if more than this share of scenes lie too close to the previous one
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
        """Lay out scenes ``spacing`` frames apart; None if too many are too close to the previous one."""
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
        if np.trace(near, offset=1) > CROWDED * max(0, len(complete) - 1):
            return None
        kept: list[int] = []
        for i in range(len(complete)):
            earlier = [k for k in kept if near[i, k]]
            if earlier:
                left_out.append(f"{self._name(complete[i])} shows the same place as {self._name(complete[earlier[0]])}")
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


#: default tolerance by the unit in which places are known
TOLERANCE = {"m": PlaceTolerance("m", 5.0, 25.0), "frames": PlaceTolerance("frames", 1.0, 10.0)}


class Scenes(ImageSource):
    """Scenes of a source of places as labelled images: references for training, queries for the test.

    Every ``spacing``-th place along the drive under the first reference condition is a scene, starting at the first
    with all its neighbours. Its training images are those of the place and of ``neighbours`` frames to either side,
    under each reference condition. Its test images are those of the place, one under each query condition.

    No image of one scene lies within the positive tolerance of the place of another, so ``spacing`` must be large
    enough: with frames it must exceed ``tolerance.positive + neighbours``; with metres at most a tenth of the scenes
    may lie too close to the previous one. Such scenes (where the car turned back or stopped), places revisited later,
    and places without an image under some condition are left out.

    Args:
        source: of places.
        references: conditions of the training images.
        queries: conditions of the test images, none of them a reference.
        spacing: frames between two scenes.
        neighbours: frames to either side that are training images too; 0 gives one image per scene and condition.
        split: the source's split that scenes are taken from.
        tolerance: within which images show the same place; None is 5 m, or 1 frame, and ignores headings.

    Raises:
        UserError: an argument is invalid, or a condition is both reference and query.
    """

    def __init__(
        self,
        source: PlaceSource,
        *,
        references: Sequence[str],
        queries: Sequence[str],
        spacing: int,
        neighbours: int = 0,
        split: PlaceSplit = "test",
        tolerance: PlaceTolerance | None = None,
    ):
        self.source, self.split = source, split
        self.references, self.queries = tuple(references), tuple(queries)
        self.spacing, self.neighbours = spacing, neighbours
        self.tolerance = tolerance or TOLERANCE[source.place_unit]
        self.name = source.name
        for key, names in (("references", self.references), ("queries", self.queries)):
            if not names or len(set(names)) < len(names):
                raise UserError(f"{key}={list(names)} must name conditions, each once", f"For example {key}=[summer]")
        if both := set(self.references) & set(self.queries):
            raise UserError(
                f"references and queries share {', '.join(sorted(both))}: test images would be training images",
                "Remove it from one of them.",
            )
        if spacing < 1 or neighbours < 0:
            raise UserError(
                f"spacing={spacing} must be 1 or more, and neighbours={neighbours} 0 or more", "spacing=10 neighbours=0"
            )

    def of(self, split: PlaceSplit) -> "Scenes":
        """Scenes of another split of the source, made in the same way; those of ``val`` serve to tune constants."""
        return Scenes(
            self.source,
            references=self.references,
            queries=self.queries,
            spacing=self.spacing,
            neighbours=self.neighbours,
            split=split,
            tolerance=self.tolerance,
        )

    def files(self, split: Split) -> list[Path]:
        """All files of the source's split, also those of no scene; nothing is rendered or decoded.

        Raises:
            UserError: files are missing, or there is no such condition.
        """
        self._check_conditions()
        return self.source.files(self.split)

    def fingerprint(self) -> str:
        """Hash that changes when the source does, or the way scenes are made from it."""
        made = [self.references, self.queries, self.spacing, self.neighbours, self.split, asdict(self.tolerance)]
        return hashlib.sha256(json.dumps([self.source.fingerprint(), made]).encode()).hexdigest()

    def spec(self) -> ImageSpec:
        """Image shape; classes are named after the frames of their places.

        Raises:
            UserError: as :meth:`read`.
        """
        names = tuple(f"frame_{frame:05d}" for frame in self._images.frame[self._scenes.centres[:, 0]])
        _, height, width, channels = self._images.images.shape
        return ImageSpec(channels, height, width, names)

    def read(self, split: Split) -> LabelledImages:
        """Training or test images of all scenes, scene by scene; labels count scenes along the drive.

        Raises:
            UserError: there is no such condition, scenes are too close together (the message gives the smallest spacing
                that works), there are fewer than two, or the source cannot be read.
        """
        rows, labels = self._rows(split)
        return LabelledImages(channels_first(self._images.images[rows]), labels)

    def conditions(self, split: Split) -> tuple[tuple[str, ...], Int64[ndarray, "n"]]:
        """The conditions of a split, and the index of each image's condition.

        Raises:
            UserError: as :meth:`read`.
        """
        names = self.references if split == "train" else self.queries
        numbers = np.array([names.index(name) if name in names else -1 for name in self._images.conditions])
        return names, numbers[self._images.traverse[self._rows(split)[0]]]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Places that are not scenes, each with the reason.

        Raises:
            UserError: as :meth:`read`.
        """
        return self._scenes.left_out

    def _rows(self, split: Split) -> tuple[Int64[ndarray, "n"], Int64[ndarray, "n"]]:
        """Images of the source's split, and their scenes."""
        scenes = self._scenes
        if split == "train":
            return np.concatenate(scenes.examples), scenes.labels_of_examples
        queries = scenes.centres[:, len(self.references) :]
        return queries.ravel(), np.repeat(np.arange(len(queries)), queries.shape[1])

    def _check_conditions(self) -> None:
        there = self.source.conditions(self.split)
        for key, names in (("references", self.references), ("queries", self.queries)):
            if absent := [name for name in names if name not in there]:
                raise UserError(
                    f"{key}={list(names)}: the {self.split} split of {self.name} has no {', '.join(absent)}; "
                    f"it has {', '.join(there)}",
                    "Choose from these.",
                )

    @cached_property
    def _images(self) -> PlaceImages:
        self._check_conditions()
        return self.source.read(self.split)

    @cached_property
    def _drive(self) -> SceneDrive:
        return SceneDrive(self._images, self.references, self.queries, self.neighbours, self.tolerance)

    @cached_property
    def _scenes(self) -> LaidScenes:
        found = self._drive.lay_out(self.spacing)
        if found is None:
            works = next((s for s in range(self.spacing + 1, len(self._drive.along)) if self._works(s)), None)
            raise UserError(
                f"spacing={self.spacing} frames with neighbours={self.neighbours}: images of one scene lie within "
                f"{self.tolerance.name} of the next",
                "No spacing works here: use fewer neighbours or a smaller tolerance."
                if works is None
                else f"The smallest spacing that works here: spacing={works}",
            )
        if len(found.examples) < 2:
            left_out = "".join(f"\n  {text}" for text in found.left_out[:5])
            raise UserError(
                f"spacing={self.spacing}, neighbours={self.neighbours}: {len(found.examples)} scenes in "
                f"{counted(len(self._drive.along), 'frame')}, but recognition needs two{left_out}",
                "Use a smaller spacing, fewer neighbours, or a longer drive.",
            )
        return found

    def _works(self, spacing: int) -> bool:
        found = self._drive.lay_out(spacing)
        return found is not None and len(found.examples) > 1
