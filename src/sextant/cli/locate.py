"""``sextant locate``: the poses of photos, a video or a ROS bag, from correspondences with posed photos."""

import math
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from sextant.console.arguments import Options, UserPath
from sextant.errors import UserError

USAGE = (
    "sextant locate map=<folder of photos with poses, or saved map> input=<photos, video or ROS bag> [output=located]"
)


class LocateOptions(Options):
    """What the user chose."""

    map: UserPath
    """folder of photos with poses (COLMAP, OpenSfM, nerfstudio, TUM, KITTI or poses.csv), or a map saved with save="""
    input: str
    """a photo, a folder of photos, a video, or a ROS bag, whose CameraInfo gives the camera"""
    output: UserPath = Path("located")
    """folder for poses.csv, trajectory.tum, a COLMAP model and pictures (default: located)"""
    camera: str | None = Field(None, examples=["1034,1036,570,377"])
    """fx,fy,cx,cy in pixels if the camera is known; otherwise the focal length is estimated"""
    every: int = Field(1, ge=1, examples=[10])
    """use every n-th image of a video or ROS bag (default: 1)"""
    image_topic: str | None = Field(None, examples=["/camera/image_raw"])
    """topic of a ROS bag's images (default: the only such topic)"""
    local: str | None = Field(None, examples=["trunk"])
    """local features: xfeat, trunk (of the network that chooses candidates), or aliked:<folder of its weights>
    (default: xfeat, or those of a saved map)"""
    save: UserPath | None = None
    """folder to save the map to for later use as map="""


def main(arguments: Sequence[str]) -> None:
    """Make or open the map, locate the images, and print where the results are."""
    options = LocateOptions.parse(arguments, USAGE)
    from sextant.applications.arguments import check_apart
    from sextant.chapters.localization import locating
    from sextant.chapters.localization.data.own_drive import find_images
    from sextant.chapters.localization.data.rosbag import Bag
    from sextant.console.console import console, note_reached
    from sextant.console.work_progress import work_progress
    from sextant.console.written import make_output, tell_written
    from sextant.tables import counted

    check_apart(options.output, input=options.input, map=options.map)
    if options.save is not None:
        check_apart(options.save, key="save", input=options.input, map=options.map, output=options.output)
    locating.files_before(options.output)
    camera = _camera(options.camera)
    frames = find_images(options.input, options.output, options.every, options.image_topic, with_odometry=False)
    make_output(options.output)
    if options.save is not None:
        make_output(options.save, "save")
    with work_progress("the map's features", "images") as progress:
        poses, paths = locating.map_of_folder(options.map, progress, options.local)
    if options.save is not None:
        poses.save(options.save)
        note_reached("map written to", str(options.save))
    console.print(f"map: {counted(len(poses.names), 'image')}, {counted(len(poses.posed.points), 'point')}")
    with work_progress("located", "images") as progress:
        results = locating.locate_frames(poses, frames, camera, options.output, paths, progress)
    written = locating.write_located(results, poses, options.output)
    if camera is None and isinstance(frames, Bag) and frames.camera is not None:
        console.print(f"note: images were straightened, camera {frames.camera}", markup=False)
    found = sum(each.found is not None and each.found.verdict == "located" for each in results)
    unreadable = sum(each.found is None for each in results)
    told = f"{found:,} of {counted(len(results), 'image')} located" + (
        f", {unreadable:,} unreadable" if unreadable else ""
    )
    tell_written(told, len(results) - found - unreadable, written, "not in the map")


def _camera(given: str | None) -> object:
    """A known camera, or None."""
    if given is None:
        return None
    try:
        fx, fy, cx, cy = (float(value) for value in given.split(","))
    except ValueError:
        fx, fy, cx, cy = (math.nan,) * 4
    if not (0 < fx < math.inf and 0 < fy < math.inf and math.isfinite(cx) and math.isfinite(cy)):
        raise UserError(
            f"camera={given}: four numbers are expected, the focal lengths above 0",
            "camera=<fx>,<fy>,<cx>,<cy> in pixels",
        )
    return fx, fy, cx, cy
