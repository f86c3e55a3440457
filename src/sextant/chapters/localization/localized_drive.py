"""Localizing the images of a drive, and writing files that state where each was taken."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Literal

import numpy as np

from sextant.applications.write_errors import telling_write_errors
from sextant.chapters.localization.data.own_drive import OwnDrive
from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.written_poses import (
    PICTURE,
    SMOOTHED,
    TABLE,
    TRAJECTORY,
    Moment,
    Replay,
    Row,
    draw_trajectory,
    write_poses,
)
from sextant.data.photo_files import nothing_usable
from sextant.data.videos import Frame
from sextant.errors import UserError
from sextant.localization.constants import FORESEEN, RECOGNISED
from sextant.reporter import SILENT, Progress
from sextant.tables import counted

#: animation of the particles, if there is to be one
ReplayKind = Literal["mp4", "gif", "none"]
#: an odometry scale that deviates from 1 by more than this factor is reported
MISTAKEN = 1.1


@dataclass(frozen=True, eq=False)
class LocalizedDrive:
    """The result of localizing a drive.

    Attributes:
        rows: where each image was taken.
        files: files that were written.
        interrupted: Ctrl-C came before the last image, and everything was written for the images before it; or later,
            and only ``files`` were written.
    """

    rows: list[Row]
    files: list[Path]
    interrupted: bool


def localize_drive(
    localizer: Localizer,
    drive: OwnDrive,
    frames: Iterable[Frame],
    output: Path,
    *,
    replay: ReplayKind = "mp4",
    smooth: bool = False,
    progress: Progress = SILENT.progress,
    watch: Callable[[Moment], None] | None = None,
) -> LocalizedDrive:
    """Localize the images of a drive one after the other, and write where each was taken.

    Ctrl-C ends the drive there: what was localized so far is written. A further Ctrl-C leaves out the other files.

    Args:
        localizer: localizer in the map; its current belief is the start.
        drive: the drive with its odometry and times; remarks are added to it.
        frames: its images, of the size of the map's.
        output: an existing folder, for ``poses.csv``, ``trajectory.tum``, ``trajectory.png`` and optional files.
        replay: write an animation of the particles.
        smooth: write ``smoothed.tum`` too; the localizer's ``lag`` must be the length of the drive.
        progress: shows the progress of the work.
        watch: called with each step as it happens.

    Raises:
        UserError: none of the images can be used, or the disk is full.
        KeyboardInterrupt: before the first image was localized.
    """
    rows, moments, interrupted = list[Row](), Replay(), False
    try:
        with progress("localizing", "images") as advance:
            for step, (frame, motion) in enumerate(drive.with_motions(frames)):
                row = Row(frame.name, localizer.step(motion, frame.image), frame.problem)
                rows.append(row)
                if watch is not None or replay != "none":
                    moment = Moment.of(step, row, localizer, frame.image)
                    moments.add(moment)
                    if watch is not None:
                        watch(moment)
                advance(step + 1, len(drive) or step + 1)
    except KeyboardInterrupt:
        if not rows:
            raise
        interrupted = not drive.endless
        if interrupted:
            drive.remarks.append(f"interrupted after {len(rows):,} of {counted(len(drive), 'image')}")
    if all(row.problem for row in rows):
        raise nothing_usable(
            f"none of {counted(len(rows), 'image')} can be used", {row.name: row.problem for row in rows}
        )
    foreseen = sum(row.told.foreseen >= FORESEEN for row in rows)  # by odometry: then they are of the map
    if elsewhere := localizer.recognised < RECOGNISED and 2 * foreseen < len(rows):
        rows = [replace(row, told=replace(row.told, lost=True)) for row in rows]
    positions, times = localizer.model.map.poses[:, :2].numpy(), drive.times_of(len(rows))
    drive.remarks.extend([*far_steps(drive, positions, localizer.unit), *doubts(localizer, rows, elsewhere)])
    with telling_write_errors(output):
        write_poses(rows, times, output)
        written = [output / TABLE, output / TRAJECTORY]
        try:
            draw_trajectory(rows, positions, output, localizer.unit)
            written.append(output / PICTURE)
            if smooth:
                with progress("smoothing", "images") as advance:
                    past = np.stack([told.pose for told in localizer.past(advance)])
                write_tum(output / SMOOTHED, times, past)
                written.append(output / SMOOTHED)
            if replay != "none":
                with progress("drawing the replay", "frames"):
                    written.append(_animated(moments, positions, output, replay, localizer.unit, drive.remarks))
        except KeyboardInterrupt:
            interrupted = True
            drive.remarks.append(f"interrupted after {written[-1].name}: only the files named here are complete")
    return LocalizedDrive(rows, written, interrupted)


def far_steps(drive: OwnDrive, positions: np.ndarray, unit: str) -> Iterator[str]:
    """A remark where a usual step of odometry is longer than the whole map."""
    steps = [float(np.hypot(*motion[:2])) for motion in drive.motions if motion is not None]
    across = float(np.hypot(*np.ptp(positions, axis=0)))
    if steps and (step := float(np.median(steps))) > across > 0:
        yield (
            f"a usual step of odometry, {step:,.4g}, is longer than the whole map, {across:,.4g} {unit}: x and y must "
            "be in the map's unit, usually metres"
        )


def doubts(localizer: Localizer, rows: list[Row], elsewhere: bool) -> Iterator[str]:
    """Remarks where images contradict odometry or the map; only one if the drive is of another map."""
    if elsewhere:
        yield (
            f"not in this map: the drive as a whole was recognised by {localizer.recognised:.2f}. Images of a place "
            f"that the map lacks have 0.5; less than {RECOGNISED} is another world, or one that has changed too much. "
            "All poses are marked as lost"
        )
        return
    if abs(math.log(scale := localizer.odometry_scale)) > math.log(MISTAKEN):
        told = "short" if scale > 1 else "long"
        yield f"the distances of odometry are too {told}: in the end they were multiplied by {scale:.2f}"
    if disbelieved := sum(row.told.disbelieved for row in rows):
        yield (
            f"at {counted(disbelieved, 'image')} odometry reported a standstill while the images showed motion: there "
            "the motion was treated as unknown"
        )
    if unknown := sum(row.told.recognised < RECOGNISED for row in rows):
        yield (
            f"{unknown:,} of {counted(len(rows), 'image')} {'resembles' if unknown == 1 else 'resemble'} the map less "
            "than its own places resemble each other: they probably show another place, or it has changed too much"
        )
    beginning = takewhile(lambda row: row.told.lost and row.told.recognised < 0.5, rows)
    if early := sum(row.told.recognised >= RECOGNISED for row in beginning):
        yield (
            f"{early:,} of the first images {'resembles' if early == 1 else 'resemble'} the map hardly more than its "
            "places resemble each other: marked as lost, as so few cannot tell this place from another"
        )
    if unforeseen := sum(row.told.foreseen < FORESEEN for row in rows):
        yield (
            f"at {counted(unforeseen, 'image')} the recent ones hardly resembled the estimated place more than any "
            "other place: either the map does not cover them, or odometry is wrong"
        )


def _animated(
    moments: Replay, positions: np.ndarray, output: Path, kind: ReplayKind, unit: Literal["m", "frames"],
    remarks: list[str],
) -> Path:  # fmt: skip
    path = output / f"replay.{kind}"
    try:
        moments.write(positions, path, unit)
    except UserError as error:
        if kind == "gif":
            raise
        remarks.append(f"{error.problem}: a GIF was written")
        path = path.with_suffix(".gif")
        moments.write(positions, path, unit)
    return path
