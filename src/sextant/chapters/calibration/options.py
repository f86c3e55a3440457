"""Options of the calibration of photos; imports nothing heavy."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from sextant.console.arguments import SPLIT, Options, UserPath

#: reads the word "none" as None
NONE = BeforeValidator(lambda text: None if text == "none" else text)
#: whether and how photos are undistorted
Undistort = Literal["crop", "all", "none"]
#: formats of other programs
Export = Literal["nerfstudio", "fspy", "ros", "kalibr"]


class NetworkOptions(Options):
    """A network of others, in place of a run."""

    network: str | None = Field(None, title="geocalib:<file> or anycalib:<file>", pattern="^(geocalib|anycalib):.",
                                examples=["geocalib:geocalib-pinhole.tar"])  # fmt: skip
    """a network of others in place of run=: geocalib:<file> or anycalib:<file>, as its authors publish it"""
    scale: UserPath | None = None
    """the scale of its spreads, from sextant benchmark calibration network=... (default: as the network gives them)"""


class FocalOptions(Options):
    """Prior knowledge of a camera's focal length."""

    focal_prior: Annotated[Literal["exif"] | Annotated[float, Field(gt=0)] | None, NONE] = Field(
        None, title="none, exif or a focal length in pixels above 0", examples=["exif"]
    )
    """none (default), exif, or a focal length in pixels of the photo"""


class CalibrationOptions(NetworkOptions, FocalOptions):
    """Options of the calibration of photos."""

    method: Literal["joint", "lines", "network"] = Field("joint", examples=["network"])
    """joint (default: network, lines and a prior on cameras), lines (no network) or network (no lines)"""
    undistort: Undistort = Field("crop", examples=["all"])
    """crop (default: no borders), all (keep every pixel, with borders) or none (no straightened photos)"""
    camera: Literal["each", "one"] = Field("each", examples=["one"])
    """each (default for photos), or one (for a video): all share one camera and lens setting, and are fused"""
    every: int | None = Field(None, ge=1, examples=[10])
    """use every n-th frame of a video (default: such that there are at most 30)"""
    gravity_prior: Annotated[Literal["exif"] | None, NONE] = Field(None, title="none or exif", examples=["exif"])
    """none (default), or exif: gravity from the phone's accelerometer, for photos that contain it"""
    colmap: bool = Field(False, examples=["true"])
    """true: also write cameras and gravity to a COLMAP database in <output>/colmap"""
    exports: Annotated[tuple[Export, ...], SPLIT] = Field(
        (), title="some of nerfstudio, fspy, ros and kalibr", examples=["ros,kalibr"]
    )
    """cameras for other programs, separated by commas: nerfstudio, fspy (and Blender), ros, kalibr"""
