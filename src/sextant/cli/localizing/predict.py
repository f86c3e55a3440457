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
from sextant.data.localization.frames import Photos, Video, find_frames
from sextant.data.localization.odometry_file import OdometryFile, motions_of, read_odometry
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
    frames = find_frames(given, output, options.every)
    odometry = None if options.odometry is None else read_odometry(options.odometry)
    if odometry is not None and odometry.names is not None and isinstance(frames, Photos) and options.odometry:
        frames = frames.in_order_of(odometry.names, options.odometry)
    motions, remarks = _motions(frames, odometry, options)
    localizer = Localizer.load(folder, particles=options.particles, start=options.start, seed=options.seed, trust=trust)
    if localizer.descriptor.describer is None:
        raise UserError(
            f"the map in {folder} was described by vectors from elsewhere, so photos cannot be described",
            "Use sextant.Localizer with step(motion, descriptor=vector).",
        )
    if localizer.image_size is None:
        raise UserError(f"the map in {folder} does not tell the size of its images", "Save it anew.")
    rows, replay = _localized(localizer, frames, motions, options)
    if all(row.problem for row in rows):
        skipped = {row.name: row.problem for row in rows}
        raise nothing_usable(f"input={given}: none of {len(rows):,} images can be used", skipped)
    positions = localizer.model.map.poses[:, :2].numpy()
    with telling_write_errors(output):
        write_poses(rows, _times(frames, odometry), output)
        draw_trajectory(rows, positions, output, localizer.unit)
        written = [output / name for name in ("poses.csv", "trajectory.tum", "trajectory.png")]
        if options.replay != "none":
            written.append(
                _animation(partial(replay.write, rows, positions, unit=localizer.unit), output, options.replay, remarks)
            )
    _tell(rows, remarks, written)
    return rows


def _motions(
    frames: Photos | Video, odometry: OdometryFile | None, options: LocalizingOptions
) -> tuple[list[np.ndarray | None], list[str]]:
    if odometry is None or options.odometry is None:
        told = "no odometry= was given: between images the particles spread as where odometry is lost"
        return [None] * len(frames), [told]
    count = frames.frames if isinstance(frames, Video) else None
    return motions_of(odometry, frames.names, frames.times_s, options.odometry, options.every, count)


def _localized(
    localizer: Localizer, frames: Photos | Video, motions: list[np.ndarray | None], options: LocalizingOptions
) -> tuple[list[Row], Replay]:
    rows, replay = list[Row](), Replay()
    assert localizer.image_size is not None
    with work_progress("localizing", "images") as progress:
        for step, (frame, motion) in enumerate(zip(frames.read(localizer.image_size), motions, strict=True)):
            told = localizer.step(motion, frame.image)
            rows.append(Row(frame.name, told, frame.problem))
            if options.replay != "none":
                replay.add(step, localizer.belief)
            progress(step + 1, len(frames))
    return rows, replay


def _times(frames: Photos | Video, odometry: OdometryFile | None) -> np.ndarray:
    """Seconds of each image: by the names or the video, by the odometry, or counted."""
    if frames.times_s is not None:
        return frames.times_s
    if odometry is not None and odometry.times_s is not None and len(odometry.times_s) == len(frames):
        return odometry.times_s
    return np.arange(len(frames), dtype=np.float64)


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
