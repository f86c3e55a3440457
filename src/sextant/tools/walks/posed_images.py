"""The images of a map and where they were taken, from any of several formats of poses."""

from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.pose_folder import PoseFolder
from sextant.errors import ArgumentError, UserError, command
from sextant.tools.inspection.drives import axes
from sextant.tools.inspection.poses import FoundPoses, found_poses, separate_models
from sextant.tools.inspection.seen import found_files
from sextant.user_files import absent


@dataclass(frozen=True, eq=False)
class PosedImages:
    """Images of a map.

    Attributes:
        paths: files of the images.
        poses: x, y in metres and heading in rad, counter-clockwise.
        source: the file that the poses are from, or the images themselves.
        remarks: remarks for the user.
    """

    paths: list[Path]
    poses: Float64[ndarray, "n 3"]
    source: Path
    remarks: tuple[str, ...]


def posed_images(folder: Path | str, *, skip_bad: bool = False) -> PosedImages:
    """Images below a folder with poses from TUM, KITTI, COLMAP, OpenSfM, nerfstudio, a table, or GPS in EXIF.

    If there are several files of poses, the one with poses of the most images is used. 3D poses are projected to the
    plane that the camera moved in, as ``sextant inspect`` finds it.

    Args:
        folder: folder with images and one such file; or the file, at most two folders below the images' folder.
        skip_bad: leave out images at exactly the pose of another, which are otherwise an error.

    Raises:
        UserError: there are no images, no poses for them, or their ground is not a plane of two world axes.

    Example:
        >>> found = posed_images("summer")  # doctest: +SKIP
        >>> found.poses.shape  # doctest: +SKIP
        (240, 3)
    """
    given = folder = Path(folder).expanduser()
    if not given.exists():
        raise ArgumentError(f"map={absent(given)}", "Give a folder of images with poses.")
    if given.is_file():
        folder = next((each for each in given.parents[:3] if found_files(each).images), given.parent)
    files = found_files(folder)
    chosen = files.tables if given == folder else (given.relative_to(folder),)
    tables = [each for file in chosen if (each := found_poses(folder, file, files.images)) is not None]
    problems = {each.file: _problem(each) for each in tables}
    usable = [each for each in tables if each.posed and not problems[each.file]]
    best = max(usable, key=lambda each: each.posed, default=None)
    models = separate_models(tables)
    try:
        paths, poses, notes = _source(folder, best, skip_bad).mapped_images()
    except UserError as error:
        if best is not None:
            raise UserError(f"{error.problem}\n{models}".rstrip(), error.fix) from None
        told = "".join(f"\n  {file}: {problem}" for file, problem in problems.items() if problem)
        raise ArgumentError(
            f"map={folder}: neither a file there nor EXIF has poses of its images{told}",
            f"{command('inspect', str(folder))} lists what was found; poses.csv with file,x,y,heading is the simplest.",
        ) from error
    remarks = (*(best.remarks if best is not None else ()), *filter(None, [models]))
    return PosedImages(paths, poses, folder if best is None else folder / best.file, (*remarks, *notes))


def _problem(found: FoundPoses) -> str:
    if found.format == "cold":
        return "is of the COLD database, which dataset=cold reads"
    return found.problem or ("" if found.headings else "has positions, but no headings")


def _source(folder: Path, best: FoundPoses | None, skip_bad: bool) -> PoseFolder:
    if best is None:
        return PoseFolder(str(folder), ".", poses="gps", skip_bad=skip_bad)
    assert best.format != "cold"
    ground = axes(best)
    if ground is None:
        raise ArgumentError(
            f"{folder / best.file}: the ground is not a plane of two world axes",
            "Align the poses to it first (COLMAP: model_orientation_aligner).",
        )
    images = folder / (best.images or ".")
    file = (folder / best.file).resolve()
    return PoseFolder(
        str(images), ".", poses=best.format, pose_file=str(file), times=None, max_gap_s=None, skip_bad=skip_bad,
        **ground,  # type: ignore[arg-type]
    )  # fmt: skip
