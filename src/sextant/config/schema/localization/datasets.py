"""Datasets for localization."""

from typing import Literal

from pydantic import Field

from sextant.config.schema.parts import Part, Positive
from sextant.config.schema.places.datasets import Traverses
from sextant.config.schema.splits import ImageSide


class Drives(Part):
    """A dataset of drives with poses."""


class PoseFolder(Drives):
    """The user's own drives with poses."""

    target: Literal["sextant.data.localization.PoseFolder"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/drives"])
    map: str = Field(examples=["map"])
    test: Traverses | None = Field(min_length=1, examples=["{run: run}"])
    validation: Traverses | None = Field(min_length=1, examples=["{first: first}"])
    poses: Literal["csv", "tum", "kitti", "colmap", "opensfm", "nerfstudio", "gps"]
    pose_file: str | None = Field(examples=["poses.csv"])
    odometry: str | None = Field(examples=["odometry.csv"])
    times: str | None = Field(examples=["names"])
    plane: Literal["xy", "xz", "yz"]
    ahead: Literal["x", "z"]
    mounting: list[float] = Field(min_length=3, max_length=3, examples=["[0.0,0.0,0.0]"])
    protocol: Literal["office", "town"]
    max_gap_s: Positive | None = Field(examples=[5.0])
    height: ImageSide = Field(examples=[64])
    width: ImageSide = Field(examples=[96])
    channels: Literal[1, 3]
    skip_bad: bool
