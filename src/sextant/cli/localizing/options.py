"""Options of localizing images; imports nothing heavy."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from sextant.cli.arguments import Options, UserPath
from sextant.errors import UserError

OUTPUT = "localization"


class LocalizingOptions(Options):
    """Options for any drive that is localized."""

    odometry: UserPath | None = None
    """TUM trajectory, or table x,y,theta (m, rad) with a row an image; without it motion is unknown"""
    particles: int | None = Field(None, ge=1, le=100_000, examples=[1000])
    """how many, up to 100000; as many as the map was tested with unless given"""
    start: Literal["uniform", "appearance"] = Field("uniform", examples=["appearance"])
    """where they begin: uniform over the map (default), or appearance: where the first image is found"""
    seed: int = Field(0, ge=0, le=2**31 - 1, examples=[1])
    """of all random numbers; 0 unless given"""
    every: int = Field(1, ge=1, examples=[10])
    """of a video or a ROS bag, every so many images; 1 unless given"""
    image_topic: str | None = Field(None, examples=["/camera/image_raw"])
    """of a ROS bag: its images; the only topic of images unless given"""
    odometry_topic: str | None = Field(None, examples=["/odom"])
    """of a ROS bag: its odometry; the only topic of odometry unless given"""
    replay: Literal["mp4", "gif", "none"] = Field("mp4", examples=["gif"])
    """animation of the particles: mp4 (default), gif or none"""
    smooth: bool = Field(False, examples=["true"])
    """also write smoothed.tum: each pose by all images of the drive, also those that came later"""

    @field_validator("odometry")
    @classmethod
    def _is_there(cls, path: Path | None) -> Path | None:
        if path is not None and path.is_dir():
            raise UserError(f"odometry={path} is a folder", "Name the file in it: a table, or a trajectory of TUM.")
        if path is not None and not path.is_file():
            raise UserError(f"odometry={path}: there is no such file", "Leave it out if there is none.")
        return path
