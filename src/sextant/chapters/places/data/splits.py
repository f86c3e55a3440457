"""Splits by place and by condition, which refuse overlaps between training and test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sextant.chapters.places.data.images import SPLITS, PlaceImages, Split
from sextant.chapters.places.data.source import PlaceSource
from sextant.errors import ArgumentError
from sextant.tables import counted


@dataclass(frozen=True)
class FrameRanges:
    """Disjoint splits of aligned traverses by frame number.

    Frames are counted from 0 in the order of their names. Adjacent ranges touch: the last frame of one and the first of
    the next are as similar as any two consecutive frames, unless some frames are left out between them.

    Args:
        train: first frame, and the one after the last; None for the end.
        val: likewise.
        test: likewise.

    Raises:
        UserError: a range is empty or negative, or two overlap.
    """

    train: tuple[int, int | None]
    val: tuple[int, int | None]
    test: tuple[int, int | None]

    def __post_init__(self) -> None:
        taken: dict[str, tuple[int, float]] = {}
        for split in SPLITS:
            start, stop = getattr(self, split)
            end = float("inf") if stop is None else stop
            if start < 0 or end <= start:
                raise ArgumentError(
                    f"frames.{split}=[{start}, {stop}] must be a first frame, 0 or more, and a frame after it",
                    f"frames.{split}='[{max(0, start)}, {max(0, start) + 100}]'",
                )
            for other, (first, last) in taken.items():
                if start < last and first < end:
                    raise ArgumentError(
                        f"frames.{split}=[{start}, {stop}] and frames.{other} share frames",
                        "Splits must share no place. The second number of a range is the frame after its last.",
                    )
            taken[split] = (start, end)

    @classmethod
    def of(cls, ranges: Mapping[str, Sequence[int | None]]) -> "FrameRanges":
        """Ranges from a config: ``{train: [0, 1600], val: [1600, 1650], test: [1650, 2400]}``.

        Raises:
            UserError: a split is missing or not of two numbers.
        """
        if set(ranges) != set(SPLITS) or any(len(entry) != 2 or entry[0] is None for entry in ranges.values()):
            raise ArgumentError(
                f"frames={dict(ranges)} must give two numbers for each of {', '.join(SPLITS)}",
                "For example frames: {train: [0, 1600], val: [1600, 1650], test: [1650, 2400]}",
            )
        return cls(**{split: (int(entry[0] or 0), entry[1]) for split, entry in ranges.items()})

    def of_split(self, split: Split, count: int) -> range:
        """The frames of a split, out of ``count`` in all.

        Raises:
            UserError: the range goes beyond the last frame.
        """
        start, stop = getattr(self, split)
        if start >= count or (stop is not None and stop > count):
            raise ArgumentError(
                f"frames.{split}=[{start}, {stop}]: there are {counted(count, 'frame')}, numbered from 0",
                f"The second number may be at most {count}; null takes all that follow.",
            )
        return range(start, count if stop is None else stop)


@dataclass(frozen=True)
class ConditionSplit:
    """Conditions of training and validation, and those of the test.

    Args:
        train: names; None for all.
        test: names; None for all.
        shared: conditions that both may have, usually that of the map in which test images are looked up.

    Raises:
        UserError: both are given and share a condition that is not ``shared``, or one is empty.
    """

    train: tuple[str, ...] | None = None
    test: tuple[str, ...] | None = None
    shared: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key, names in (("train", self.train), ("test", self.test)):
            if names is not None and (not names or len(set(names)) < len(names)):
                raise ArgumentError(
                    f"{key}_conditions={list(names)} must name conditions, each once, or be null for all",
                    f"{key}_conditions=null",
                    of=self,
                )
        both = set(self.train or ()) & set(self.test or ()) - set(self.shared)
        if both:
            raise ArgumentError(
                f"train_conditions and test_conditions share {', '.join(sorted(both))}",
                f"Remove it from one of them, or name the map's condition: shared_conditions=[{min(both)}]",
                of=self,
            )

    def of_split(self, split: Split) -> tuple[str, ...] | None:
        """The conditions of a split; validation has those of training, so that nothing is tuned on the test's."""
        return self.test if split == "test" else self.train


class ConditionSplitSource:
    """A source of places whose splits also differ in condition.

    Args:
        source: the source to split.
        choice: conditions of each split.
    """

    def __init__(self, source: PlaceSource, choice: ConditionSplit):
        self.source, self.choice = source, choice
        self.name, self.place_unit = source.name, source.place_unit

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The conditions chosen for the split.

        Raises:
            UserError: the source has no such condition.
        """
        there, chosen = self.source.conditions(split), self.choice.of_split(split)
        if chosen is None:
            return there
        absent = [name for name in chosen if name not in there]
        if absent:
            key = "task.test_conditions" if split == "test" else "task.train_conditions"
            raise ArgumentError(
                f"{key}={list(chosen)}: the {split} split of dataset={self.name} has no {', '.join(absent)}; "
                f"it has {', '.join(there)}",
                "Choose from these, the map's first, or null for all.",
            )
        return chosen

    def files(self, split: Split) -> list[Path]:
        """Those of the source.

        Raises:
            UserError: as :meth:`conditions`, and whatever the source raises.
        """
        self.conditions(split)
        return self.source.files(split)

    def fingerprint(self) -> str:
        """The fingerprint of the source: the choice of conditions is part of the run's config."""
        return self.source.fingerprint()

    def read(self, split: Split) -> PlaceImages:
        """The images of a split under its conditions.

        Raises:
            UserError: as :meth:`conditions`, and whatever the source raises.
        """
        chosen, images = self.conditions(split), self.source.read(split)
        return images if chosen == images.conditions else images.only_conditions(chosen)
