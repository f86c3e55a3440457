"""Calibrates photos, writes their cameras to files, and prints them."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.chapters.calibration.clip import chosen_frames, write_frames
from sextant.chapters.calibration.jointly import Method
from sextant.chapters.calibration.network_scale import read_scale
from sextant.chapters.calibration.options import CalibrationOptions, NetworkOptions
from sextant.chapters.calibration.other_networks import card_text, open_network
from sextant.chapters.calibration.written_cameras import WrittenCameras, write_cameras
from sextant.console.console import console, rows_table
from sextant.console.work_progress import Counted, work_progress
from sextant.console.written import make_output, skipped_of, tell_skipped, tell_written
from sextant.data.photo_files import nothing_usable
from sextant.tables import counted


def predict_calibrations(
    calibrator: PhotoCalibrator, paths: Sequence[Path], output: Path, options: CalibrationOptions
) -> list[dict[str, Any]]:
    """Calibrate photos, write the results into ``output`` and show them; failed photos are named and skipped.

    Raises:
        UserError: no photo could be calibrated, the photos cannot be of one camera, or the disk is full.
    """
    make_output(output)
    photos = Counted("calibrating", "photos", paths)
    written = write_cameras(
        calibrator, photos, output, **options.model_dump(exclude={"method", "network", "scale", "every"})
    )
    tell(written, skipped_of(written.rows, f"none of {counted(len(paths), 'photo')} could be calibrated"))
    return written.rows


def video_frames(path: Path, output: Path, every: int | None) -> list[Path]:
    """Frames of a video as photos, written below ``output``; tells how many there are, and which cannot be decoded.

    Raises:
        UserError: it is no video, none of its frames can be decoded, or the disk is full.
    """
    make_output(output)
    video = chosen_frames(path, every)
    with work_progress("reading", "frames") as advance:
        frames = list[tuple[Path, str]]()
        for frame in write_frames(video, output):
            frames.append(frame)
            advance(len(frames), len(video))
    failed = {file.name: problem for file, problem in frames if problem}
    if len(failed) == len(frames):
        raise nothing_usable(
            f"input={path}: none of {counted(len(frames), 'frame')} can be used", failed, "Give another video."
        )
    tell_skipped(failed)
    thinned = f", one of every {video.every}" if video.every > 1 else ""
    console.print(f"{path.name}: {len(frames) - len(failed):,} of {counted(video.frames, 'frame')}{thinned}")
    return [file for file, problem in frames if not problem]


def calibrator_of_others(options: NetworkOptions, method: Method = "joint") -> PhotoCalibrator:
    """The calibrator of a network of others; prints what is known about it.

    Raises:
        UserError: there is no such file, or it does not fit.
    """
    assert options.network is not None
    network = open_network(options.network)
    scale = None if options.scale is None else read_scale(options.scale, network.card)
    spreads = f"spreads by {options.scale}" if scale else "spreads as the network gives them"
    console.print(f"{card_text(network.card)}; {spreads}", markup=False, soft_wrap=True)
    return PhotoCalibrator(network, method, scale=scale)


#: an interval within this share of EXIF's focal length gains nothing from it
EXACT = 0.05


def tell(written: WrittenCameras, skipped: Mapping[str, str]) -> None:
    """Print the cameras, doubts about them, which photos failed, and where the files are."""
    table = [
        {"photo": Path(row["file"]).name, "tilt °": f"{row['tilt_deg']:+.1f}", "roll °": f"{row['roll_deg']:+.1f}",
         "focal px [95 %]": f"{row['focal_px']:.0f}{_interval(row)}",
         "vfov °": f"{row['vfov_deg']:.1f}", "k1": f"{row['k1']:+.3f}",
         "trust": row["confidence"]["verdict"]}
        for row in written.rows if row["file"] not in skipped
    ]  # fmt: skip
    console.print(rows_table("Cameras", table))
    for row in written.rows:
        if reasons := "; ".join([*row.get("confidence", {}).get("reasons", ()), *_hint(row)]):
            console.print(f"{Path(row['file']).name}: {reasons}", style="dim", markup=False, soft_wrap=True)
    tell_skipped(skipped)
    if summary := written.summary:
        freedom = summary["degrees_of_freedom"]
        agreement = (
            f"chi-square {summary['chi_square']:.1f} with {freedom} degrees of freedom, p = {summary['p_value']:.2g}"
            if freedom
            else "no other photo confirms it"
        )
        told = f"{len(summary['kept'])} of {counted(summary['photos'], 'photo')}"
        console.print(f"One camera from {told}: {agreement}; {summary['matches']}")
    if written.earlier:
        folder, told = written.files[0].parent, "; ".join(written.earlier)
        console.print(f"note: {folder} also holds results of an earlier run: {told}", markup=False, soft_wrap=True)
    tell_written(f"{counted(len(table), 'photo')} calibrated", len(skipped), written.files)


def _interval(row: Mapping[str, Any]) -> str:
    ends = row["intervals"]["95"]["focal_px"]
    return f" [{ends[0]:.0f}, {ends[1]:.0f}]" if all(map(math.isfinite, ends)) else ""


def _hint(row: Mapping[str, Any]) -> list[str]:
    """EXIF's focal length as a hint, where it was not used and would help."""
    known = row.get("exif_focal_px")
    if not known or "focal_prior" in str(row.get("intervals_by", "")):
        return []
    low, high = row["intervals"]["95"]["focal_px"]
    return (
        []
        if low > known * (1 - EXACT) and high < known * (1 + EXACT)
        else [f"EXIF gives {known:,.0f} px; to use it: focal_prior=exif"]
    )
