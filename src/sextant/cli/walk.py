"""``sextant walk``: localize images of an unknown camera in a map of another season."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from sextant.chapters.calibration.options import FocalOptions
from sextant.chapters.localization.options import LocalizingOptions
from sextant.console.arguments import UserPath

USAGE = (
    "sextant walk input=<folder of photos or video> map=<folder of images with poses, or a saved map> [output=walk] "
    "[odometry=<table>]"
)


class WalkOptions(LocalizingOptions, FocalOptions):
    """What the user chose."""

    input: str
    """folder of photos in the order of their names, a video or a ROS bag, all of one camera"""
    map: str
    """folder of images with poses of any format, the file of these, or a saved map, such as an earlier walk wrote"""
    output: UserPath = Path("walk")
    """folder for report.md, poses, cameras, the map and pictures (default: walk)"""
    run: str = "zoo:calibration"
    """the network that calibrates (default: the package's)"""
    descriptor: str | None = Field(None, examples=["Hog"])
    """describes images: a run of place recognition, Hog, Pixels, PatchNormalised or WhitenedPCA (default: zoo:places,
    unless images are small)"""
    held: Literal["mounted", "by_hand", "level"] = Field("mounted", examples=["by_hand"])
    """mounted: tilt and roll are the same in all images (default); by_hand: each has its own; level: none"""
    photos: int = Field(40, ge=1, examples=[40])
    """images of each camera to calibrate it by, evenly spaced (default: 40)"""
    rows: int | None = Field(None, ge=8, le=1080, examples=[120])
    """height of the straightened images, 8 to 1080 (default: 120)"""
    vfov_deg: float | None = Field(None, examples=[55])
    """vertical field of view of these (default: the largest that both cameras cover)"""
    skip_bad: bool = Field(False, examples=["true"])
    """true: leave out map images at the very pose of another; otherwise they are an error"""


def main(arguments: Sequence[str]) -> None:
    """Calibrate, straighten, describe and localize the images, and print where the report is."""
    options = WalkOptions.parse(arguments, USAGE)
    from sextant.chapters.calibration.calibrator import PhotoCalibrator
    from sextant.chapters.localization.predict import tell_poses
    from sextant.console.work_progress import work_progress
    from sextant.tools.walks.walking import localize_walk

    walk = localize_walk(
        **options.model_dump(exclude={"run"}), calibrator=PhotoCalibrator.load(options.run), progress=work_progress
    )
    tell_poses(walk.rows, list(walk.remarks), list(walk.files), interrupted=walk.interrupted)
