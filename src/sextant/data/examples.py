"""Images for learning by example: classes that a network is trained on, and classes given by a few examples each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from sextant.data.datamodule import ImageData, in_memory, stratified_split
from sextant.data.source import LabelledImages
from sextant.errors import ArgumentError, UserError
from sextant.tables import counted


@dataclass(frozen=True)
class ExampleSettings:
    """Which images are considered.

    Attributes:
        images: how many of the training split, as evenly over the classes as possible; None: all.
        novel_classes: the number of classes, counted from the last, that the network is not trained on and that are
            given by examples alone; the test is among them. 0: the network and the examples have the same classes.
        examples: number per class to which filters and SVMs are fitted; None: all.
        held_out: whether images are held out for validation; otherwise all are examples and ``tuning`` is empty.
    """

    images: int | None = None
    novel_classes: int = 0
    examples: int | None = None
    held_out: bool = True


class ExampleData(ImageData):
    """The splits ``train`` (for the network), ``validation``, ``examples``, ``tuning`` and ``test`` of a source.

    ``validation`` monitors the network; ``tuning`` holds the validation images of the tested classes. Which images are
    taken depends on the run's seed; the validation split does not.

    Args:
        settings: which images are considered.
        other arguments: as for :class:`ImageData`.

    Attributes:
        test_positions: positions of the tested images in the source's test split, known once it is read.

    Raises:
        UserError: on setup, if there are fewer images than requested.
    """

    def __init__(self, *args: object, settings: ExampleSettings, **keywords: object):
        super().__init__(*args, **keywords)  # type: ignore[arg-type]
        self.settings, self.test_positions = settings, np.zeros(0, np.int64)

    @property
    def tested(self) -> list[int]:
        """Labels of the classes that are tested."""
        count = len(self.source.spec().classes)
        return list(range(count - self.settings.novel_classes if self.settings.novel_classes else 0, count))

    @property
    def learnt(self) -> list[int]:
        """Labels of the classes that the network is trained on."""
        return list(range(len(self.source.spec().classes) - self.settings.novel_classes))

    def test_conditions(self) -> dict[str, Bool[ndarray, "n"]]:
        """Which test images belong to each condition, if the source has several."""
        if not hasattr(self.source, "conditions"):
            return {}
        names, numbers = self.source.conditions("test")
        return {name: numbers == number for number, name in enumerate(names)}

    def setup(self, stage: str) -> None:
        """Read the splits that ``stage`` needs: the test split for ``test``, all others for every other stage."""
        if stage != "test" and "examples" not in self._splits:
            self._setup_examples(self.source.read("train"))
        if stage == "test" and "test" not in self._splits:
            found = self.source.read("test")
            self.test_positions = np.flatnonzero(np.isin(found.labels, self.tested))
            self._splits["test"] = in_memory(_of(found, self.tested))

    def _setup_examples(self, data: LabelledImages) -> None:
        settings = self.settings
        if not settings.held_out:
            every = in_memory(data)
            self._splits |= {"train": every, "validation": every, "examples": every, "tuning": every.none()}
            return
        try:
            train, validation = stratified_split(data.labels, self.validation_fraction, self.split_seed)
        except ValueError as error:
            raise UserError(
                f"dataset={self.source.name}: no validation split can be made: {error}", "Add images to that class."
            ) from None
        if settings.images is not None:
            if settings.images > len(train):
                raise ArgumentError(
                    f"images={settings.images:,}: dataset={self.source.name} has "
                    f"{counted(len(train), 'training image')}, and {len(validation):,} held out",
                    f"Choose at most {len(train)}, or null for all.",
                    of=self,
                )
            train = _in_turns(data.labels, train, self.seed)[: settings.images]
        kept, held_out = (LabelledImages(data.images[rows], data.labels[rows]) for rows in (train, validation))
        examples = _of(kept, self.tested)
        if settings.examples is not None:
            examples = self._few(examples, settings.examples)
        splits = {
            "train": _of(kept, self.learnt),
            "validation": _of(held_out, self.learnt),
            "examples": examples,
            "tuning": _of(held_out, self.tested),
        }
        self._splits |= {name: in_memory(images) for name, images in splits.items()}

    def _few(self, examples: LabelledImages, each: int) -> LabelledImages:
        """``each`` examples of every class."""
        counts = {label: int((examples.labels == label).sum()) for label in self.tested}
        least = min(counts, key=lambda label: counts[label])
        if counts[least] < each:
            raise ArgumentError(
                f"examples={each}: there are {counted(counts[least], 'training image')} of class "
                f"{self.source.spec().classes[least]} to choose from",
                f"Choose at most {counts[least]}, null for all, or more images."
                if counts[least]
                else "Choose more images.",
                of=self,
            )
        rows = _in_turns(examples.labels, np.arange(len(examples.labels)), self.seed)[: each * len(counts)]
        return LabelledImages(examples.images[rows], examples.labels[rows])


def _of(data: LabelledImages, labels: list[int]) -> LabelledImages:
    rows = np.isin(data.labels, labels)
    return data if rows.all() else LabelledImages(data.images[rows], data.labels[rows])


def _in_turns(labels: Int64[ndarray, "n"], rows: Int64[ndarray, "m"], seed: int) -> Int64[ndarray, "m"]:
    """The rows in random order within each class, classes taking turns: any prefix is as balanced as possible."""
    rng = np.random.default_rng(seed)
    classes = [rng.permutation(rows[labels[rows] == label]) for label in np.unique(labels[rows])]
    longest = max(map(len, classes))
    turns = [members[turn] for turn in range(longest) for members in classes if turn < len(members)]
    return np.array(turns, np.int64)
