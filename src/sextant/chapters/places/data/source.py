"""The interface of place datasets."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

from sextant.chapters.places.data.images import PlaceImages
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.data.rendered import RenderedSource

from sextant.chapters.places.data.images import Split


@runtime_checkable
class PlaceSource(Protocol):
    """A dataset of places in three splits that share no place.

    Attributes:
        name: name of the dataset in messages.
        place_unit: ``m`` if places are known by position, ``frames`` if only by order.
    """

    name: str
    place_unit: Literal["m", "frames"]

    def conditions(self, split: Split) -> tuple[str, ...]:
        """The conditions of a split, the map's first; nothing is read.

        Raises:
            UserError: there is no such split.
        """

    def files(self, split: Split) -> list[Path]:
        """The files that ``split`` is read from; nothing is rendered or decoded.

        Raises:
            UserError: the files are missing.
        """

    def fingerprint(self) -> str:
        """Hash that changes when the data does."""

    def read(self, split: Split) -> PlaceImages:
        """The images of a split with their places.

        Raises:
            UserError: a file cannot be read; the message names it.
        """


def as_place_source(dataset: Any) -> PlaceSource:
    """A dataset as a source of places.

    Raises:
        UserError: it has no places.
    """
    if hasattr(dataset, "plan"):  # a rendered world: its modules are loaded anyway
        from sextant.chapters.places.data.towns import TownCitySource, TownSeasonsSource
        from sextant.data.worlds.towns import TownCity, TownSeasons

        if isinstance(dataset, TownSeasons):
            return TownSeasonsSource(dataset)
        if isinstance(dataset, TownCity):
            return TownCitySource(dataset)
    elif isinstance(dataset, PlaceSource):
        return dataset
    name = getattr(dataset, "name", type(dataset).__name__)
    raise UserError(
        f"dataset={name} has no places, which task=place_recognition needs",
        "Choose town_seasons or town_city (rendered here), nordland or place_folders (your own).",
    )


def rendered_place_source(source: PlaceSource) -> "RenderedSource | None":
    """The part of a source that is rendered, if it has one."""
    from sextant.data.rendered import RenderedSource

    while hasattr(source, "source"):
        source = source.source
    return source if isinstance(source, RenderedSource) else None
