"""Datasets of places."""

from typing import Annotated, Literal

from pydantic import Field

from sextant.config.schema.parts import Node, Part
from sextant.config.schema.splits import ImageSide

#: first frame, and the frame after the last
FrameRange = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
Traverses = dict[str, str]


class Places(Part):
    """A dataset of places."""


class RangeBySplit(Node):
    """A range of frames for each split."""

    train: FrameRange = Field(examples=["[0,1600]"])
    val: FrameRange = Field(examples=["[1600,1650]"])
    test: FrameRange = Field(examples=["[1650,2400]"])


class Nordland(Places):
    """Aligned frames, with one folder per season."""

    target: Literal["sextant.data.places.Nordland"] = Field(alias="_target_")
    conditions: list[str] = Field(min_length=1, examples=["[summer,winter]"])
    frames: RangeBySplit
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[64])
    channels: Literal[1, 3]
    folder: str = Field(examples=["nordland"])
    skip_bad: bool


class PlaceFolders(Places):
    """The user's own places."""

    later = ("name",)
    target: Literal["sextant.data.places.PlaceFolders"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/places"])
    train: Traverses | None = Field(examples=["{summer: train/summer, winter: train/winter}"])
    val: Traverses | None = Field(examples=["{summer: val/summer, winter: val/winter}"])
    test: Traverses | None = Field(examples=["{reference: reference, query: query}"])
    places: Literal["csv", "utm", "gps", "order", "name"]
    csv: str = Field(examples=["poses.csv"])
    height: ImageSide = Field(examples=[64])
    width: ImageSide = Field(examples=[96])
    channels: Literal[1, 3]
    skip_bad: bool
    allow_duplicates: bool
    name: str | None = Field(default=None, min_length=1, examples=["my_streets"])
