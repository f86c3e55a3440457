"""``sextant walk``: localize images from an uncalibrated camera in a map from another season."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from sextant.chapters.calibration.options import FocalOptions
from sextant.chapters.localization.options import LocalizingOptions
from sextant.console.arguments import UserPath

USAGE = (
    "sextant walk input=<folder of photos or video> map=<folder of images with poses, or saved map> [output=walk] "
    "[odometry=<table>]"
)


class WalkOptions(LocalizingOptions, FocalOptions):
    """What the user chose."""

    input: str
    """folder of photos in order of file name, a video or a ROS bag, from a single camera"""
    map: str
    """folder of images with poses in any format, its pose file, or a saved map, such as a walk's"""
    output: UserPath = Path("walk")
    """folder for report.md, poses, cameras, the map and pictures (default: walk)"""
    run: str = "zoo:calibration"
    """the calibration network: a run or a checkpoint (default: the one included in the package)"""
    descriptor: str | None = Field(None, examples=["Hog"])
    """image descriptor: a place recognition run, Hog, Pixels, PatchNormalised or WhitenedPCA (default: zoo:places,
    unless images are small)"""
    held: Literal["mounted", "by_hand", "level"] = Field("mounted", examples=["by_hand"])
    """mounted: same tilt and roll in all images (default); by_hand: different in each image; level: zero"""
    photos: int = Field(40, ge=1, examples=[40])
    """number of evenly spaced images to calibrate each camera from (default: 40)"""
    rows: int | None = Field(None, ge=8, le=1080, examples=[120])
    """height of the straightened images in pixels, 8 to 1080 (default: 120)"""
    vfov_deg: float | None = Field(None, examples=[55])
    """vertical field of view of the straightened images in degrees (default: the largest that both cameras cover)"""
    skip_bad: bool = Field(False, examples=["true"])
    """true: leave out map images whose pose duplicates another's; otherwise they are an error"""


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
