"""Options of localizing images; imports nothing heavy."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from sextant.console.arguments import Options, UserPath
from sextant.errors import UserError
from sextant.user_files import absent

OUTPUT = "localization"


class LocalizingOptions(Options):
    """Options for any drive that is localized."""

    odometry: UserPath | None = None
    """TUM trajectory, or table x,y,theta (m, rad) with times or one row per image; without it, motion is unknown"""
    particles: int | None = Field(None, ge=1, le=100_000, examples=[1000])
    """number of particles, up to 100000 (default: the number used in the map's test)"""
    start: Literal["uniform", "appearance"] = Field("uniform", examples=["appearance"])
    """initial particles: uniform over the map (default), or appearance: at map images similar to the first image"""
    seed: int = Field(0, ge=0, le=2**31 - 1, examples=[1])
    """random seed (default: 0)"""
    every: int = Field(1, ge=1, examples=[10])
    """use every n-th image of a video or ROS bag (default: 1)"""
    image_topic: str | None = Field(None, examples=["/camera/image_raw"])
    """topic of a ROS bag's images (default: the only such topic)"""
    odometry_topic: str | None = Field(None, examples=["/odom"])
    """topic of a ROS bag's odometry (default: the only such topic)"""
    replay: Literal["mp4", "gif", "none"] = Field("mp4", examples=["gif"])
    """animation of the particles: mp4 (default), gif or none"""
    smooth: bool = Field(False, examples=["true"])
    """true: also write smoothed.tum, whose poses are estimated from all images, including later ones"""

    @field_validator("odometry")
    @classmethod
    def _is_there(cls, path: Path | None) -> Path | None:
        if path is not None and path.is_dir():
            raise UserError(f"odometry={path} is a folder", "Name the file in it: a table, or a trajectory of TUM.")
        if path is not None and not path.is_file():
            raise UserError(f"odometry={absent(path)}", "Leave it out if there is none.")
        return path
