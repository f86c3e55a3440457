"""From photos or a video to where each was taken."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from sextant.applications.localization.localizer import Localizer
from sextant.applications.localization.written_poses import Replay, Row, draw_trajectory, write_poses
from sextant.applications.write_errors import telling_write_errors
from sextant.cli.console import console
from sextant.cli.localizing.options import LocalizingOptions
from sextant.cli.skipped_files import tell_skipped
from sextant.cli.work_progress import work_progress
from sextant.data.localization.own_drive import OwnDrive, open_drive
from sextant.data.localization.pose_formats import write_tum
from sextant.data.unusable_files import nothing_usable
from sextant.errors import UserError


def predict_poses(
    folder: Path, given: str, output: Path, options: LocalizingOptions, *, trust: bool = False
) -> list[Row]:
    """Localize the images in their order, write everything into ``output`` and tell it.

    Args:
        folder: of the map.
        given: photos or a video.
        output: folder for what is found.
        options: chosen by the user.
        trust: build parts of the user's own that the map names.

    Raises:
        UserError: there is no image that can be used, the odometry does not go with them, the map is damaged or cannot
            describe images, or the disk is full.
    """
    drive = open_drive(
        given,
        options.odometry,
        output,
        every=options.every,
        image_topic=options.image_topic,
        odometry_topic=options.odometry_topic,
    )
    remarks = drive.remarks
    chosen = options.model_dump(include={"particles", "start", "seed"})
    localizer = Localizer.load(folder, **chosen, lag=len(drive.frames) if options.smooth else 0, trust=trust)
    if localizer.descriptor.describer is None:
        raise UserError(
            f"the map in {folder} was described by vectors from elsewhere, so photos cannot be described",
            "Use sextant.Localizer with step(motion, descriptor=vector).",
        )
    if localizer.image_size is None:
        raise UserError(f"the map in {folder} does not tell the size of its images", "Save it anew.")
    rows, replay = _localized(localizer, drive, options)
    if all(row.problem for row in rows):
        skipped = {row.name: row.problem for row in rows}
        raise nothing_usable(f"input={given}: none of {len(rows):,} images can be used", skipped)
    positions = localizer.model.map.poses[:, :2].numpy()
    with telling_write_errors(output):
        write_poses(rows, drive.times_s, output)
        draw_trajectory(rows, positions, output, localizer.unit)
        written = [output / name for name in ("poses.csv", "trajectory.tum", "trajectory.png")]
        if options.smooth:
            written.append(output / "smoothed.tum")
            with work_progress("smoothing", "images") as progress:
                poses = np.stack([told.pose for told in localizer.past(progress)])
            write_tum(written[-1], drive.times_s, poses)
        if options.replay != "none":
            written.append(
                _animation(partial(replay.write, rows, positions, unit=localizer.unit), output, options.replay, remarks)
            )
    _tell(rows, remarks, written)
    return rows


def _localized(localizer: Localizer, drive: OwnDrive, options: LocalizingOptions) -> tuple[list[Row], Replay]:
    rows, replay = list[Row](), Replay()
    assert localizer.image_size is not None
    with work_progress("localizing", "images") as progress:
        for step, (frame, motion) in enumerate(
            zip(drive.frames.read(localizer.image_size), drive.motions, strict=True)
        ):
            told = localizer.step(motion, frame.image)
            rows.append(Row(frame.name, told, frame.problem))
            if options.replay != "none":
                replay.add(step, localizer.belief)
            progress(step + 1, len(drive.frames))
    return rows, replay


def _animation(write: Callable[[Path], None], output: Path, kind: str, remarks: list[str]) -> Path:
    path = output / f"replay.{kind}"
    with work_progress("drawing the replay", "frames"):
        try:
            write(path)
        except UserError as error:
            if kind == "gif":
                raise
            remarks.append(f"{error.problem}: a GIF was written")
            path = path.with_suffix(".gif")
            write(path)
    return path


def _tell(rows: list[Row], remarks: list[str], written: list[Path]) -> None:
    lost, unseen = sum(row.told.lost for row in rows), {row.name: row.problem for row in rows if row.problem}
    degenerate = sum(row.told.degenerate for row in rows)
    console.print(
        f"{len(rows):,} images, {len(rows) - lost:,} localized, {lost:,} lost"
        + (f", [red]{len(unseen):,} could not be used[/]: nothing was seen there" if unseen else "")
    )
    tell_skipped(unseen)
    if degenerate:
        console.print(f"{degenerate:,} images could not have been taken anywhere near a particle and were dropped")
    for remark in remarks:
        console.print(f"note: {remark}", markup=False)
    console.print("\n".join(map(str, written)), markup=False, soft_wrap=True)
