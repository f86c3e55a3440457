"""Places as classes: recognise a scene, known from one image or many, under another condition."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.scene_drive import LaidScenes, SceneDrive
from sextant.chapters.places.data.source import PlaceSource
from sextant.chapters.places.data.split import Split as PlaceSplit
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.data.source import ImageSource, ImageSpec, LabelledImages, Split, channels_first
from sextant.errors import UserError

#: default tolerance by the unit in which places are known
TOLERANCE = {"m": PlaceTolerance("m", 5.0, 25.0), "frames": PlaceTolerance("frames", 1.0, 10.0)}


class Scenes(ImageSource):
    """Scenes of a source of places as labelled images: references for training, queries for the test.

    Every ``spacing``-th place along the drive under the first reference condition is a scene, starting at the first
    with all its neighbours. Its training images are those of the place and of ``neighbours`` frames to either side,
    under each reference condition. Its test images are those of the place, one under each query condition.

    No image of one scene lies within the positive tolerance of the place of another. So ``spacing`` must be large
    enough. With frames it must exceed ``tolerance.positive + neighbours``; with metres at most a tenth of the scenes
    may lie too close to the one before. These, where the car turned back or stopped, and places revisited later are not
    new scenes: they are left out, as is a place without an image under a condition.

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
        """Scenes of another split of the source, made in the same way; those of ``val`` serve to choose constants."""
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
        """The files of the source's split, whichever of them are scenes; nothing is rendered or decoded.

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
                f"{len(self._drive.along)} frames, and recognition needs two{left_out}",
                "Use a smaller spacing, fewer neighbours, or a longer drive.",
            )
        return found

    def _works(self, spacing: int) -> bool:
        found = self._drive.lay_out(spacing)
        return found is not None and len(found.examples) > 1
