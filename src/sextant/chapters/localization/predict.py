"""Localizes photos or a video and writes the poses to files."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from sextant.chapters.localization.data.own_drive import open_drive
from sextant.chapters.localization.localized_drive import localize_drive
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.options import LocalizingOptions
from sextant.chapters.localization.written_poses import Moment, Row, refuse_to_replace_poses
from sextant.console.console import console
from sextant.console.work_progress import work_progress
from sextant.console.written import tell_skipped
from sextant.errors import ArgumentError, UserError
from sextant.tables import counted

#: makes, for a localizer, a context whose value is called with each step
Watched = Callable[[Localizer], AbstractContextManager[Callable[[Moment], None] | None]]


def predict_poses(
    folder: Path,
    given: str,
    output: Path,
    options: LocalizingOptions,
    *,
    trust: bool = False,
    watched: Watched = lambda localizer: nullcontext(None),
) -> list[Row]:
    """Localize the images in order, write the results into ``output`` and print a summary.

    Args:
        folder: folder of the map.
        given: photos, a video, a ROS bag or a camera.
        output: folder for the results.
        options: options chosen by the user.
        trust: allow user-defined parts that the map names.
        watched: shows each step during the drive.

    Raises:
        SystemExit: with status 130 if Ctrl-C comes before the last image; results until then are written.
        UserError: no image can be used, the odometry does not match the images, the map is damaged or cannot describe
            images, or the disk is full.
    """
    read = options.model_dump(include={"every", "image_topic", "odometry_topic"})
    refuse_to_replace_poses(
        output, smooth=options.smooth, replay=options.replay, odometry=options.odometry, input=given
    )
    drive = open_drive(given, options.odometry, output, **read)
    if options.smooth and drive.endless:
        raise ArgumentError(f"smooth=true needs the last image, and input={given} has none", "Leave out smooth=.")
    chosen = options.model_dump(include={"particles", "start", "seed"})
    localizer = Localizer.load(folder, **chosen, lag=len(drive) if options.smooth else 0, trust=trust)
    if localizer.descriptor.describer is None:
        raise UserError(
            f"the map in {folder} was built from descriptors computed elsewhere, so photos cannot be described",
            "Use sextant.Localizer with step(motion, descriptor=vector).",
        )
    if localizer.image_size is None:
        raise UserError(f"the map in {folder} does not record the size of its images", "Save it again.")
    with watched(localizer) as watch:
        found = localize_drive(
            localizer, drive, drive.frames.read(localizer.image_size), output,
            replay=options.replay, smooth=options.smooth, progress=work_progress, watch=watch,
        )  # fmt: skip
    tell_poses(found.rows, drive.remarks, found.files, interrupted=found.interrupted)
    return found.rows


def tell_poses(rows: list[Row], remarks: list[str], written: list[Path], *, interrupted: bool = False) -> None:
    """Print how many images were localized, which could not be used and why, and where the files are.

    Raises:
        SystemExit: with status 130 if the drive was interrupted.
    """
    lost, unseen = sum(row.told.lost for row in rows), {row.name: row.problem for row in rows if row.problem}
    degenerate = sum(row.told.degenerate for row in rows)
    console.print(
        f"{counted(len(rows), 'image')}, {len(rows) - lost:,} localized, {lost:,} lost"
        + (f", [red]{len(unseen):,} could not be used[/] and count as missing" if unseen else "")
    )
    tell_skipped(unseen)
    if degenerate:
        console.print(f"{counted(degenerate, 'image was', 'images were')} not explained by any particle, and dropped")
    for remark in remarks:
        console.print(f"note: {remark}", markup=False)
    console.print("\n".join(map(str, written)), markup=False, soft_wrap=True)
    if interrupted:
        sys.exit(130)
