"""Numbers and files by split, and types common to rendered images."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from sextant.config.schema.parts import Node
from sextant.ranges import Count


class BySplit(Node):
    """A number for each split."""

    train: Count = Field(examples=[400])
    val: Count = Field(examples=[60])
    test: Count = Field(examples=[100])


class FileBySplit(Node):
    """A file for each split, or none."""

    train: str | None = Field(examples=["kitti/poses/00.txt"])
    val: str | None = Field(examples=["kitti/poses/06.txt"])
    test: str | None = Field(examples=["kitti/poses/05.txt"])


MapFile = Annotated[str, Field(min_length=1)]


class MapBySplit(Node):
    """A GeoJSON file for each split, or none."""

    train: MapFile | None = Field(examples=["mytown.geojson"])
    val: MapFile | None = Field(examples=["mytown.geojson"])
    test: MapFile | None = Field(examples=["mytown.geojson"])


def _map_or_maps(value: object) -> object:
    if value is None or isinstance(value, str | Mapping):
        return value
    raise ValueError("must be a GeoJSON file, {train: ..., val: ..., test: ...}, or null for an invented town")


Streets = Annotated[
    MapFile | MapBySplit | None,
    Field(examples=["mytown.geojson"]),
    BeforeValidator(_map_or_maps),
]
Samples = Literal[1, 4, 9, 16]
BlockSide = Annotated[float, Field(ge=60, le=400)]
Conditions = Annotated[list[str | dict[str, Any]], Field(min_length=1, examples=["[summer_noon,winter_dusk]"])]
