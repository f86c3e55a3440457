"""Comparison of an estimated trajectory with its reference, from files."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from sextant.chapters.localization.data.pose_formats import read_kitti, read_tum_matrices
from sextant.chapters.localization.data.posed_photos import read_posed_table
from sextant.chapters.localization.data.recorded_poses import RECORDED, read_recorded, recorded_format
from sextant.chapters.places.data.pose_files import read_pose_table
from sextant.data.reconstructions import (
    NAMED_FORMATS,
    NamedFormat,
    PosedImage,
    Reconstruction,
    named_format,
    read_reconstruction,
    reconstruction_of,
)
from sextant.errors import ArgumentError, UserError
from sextant.evaluation.trajectory_error import (
    Alignment,
    ErrorStatistics,
    absolute_errors,
    align,
    relative_errors,
    segment_errors,
)
from sextant.ranges import NonNegative, checked
from sextant.tables import counted
from sextant.user_files import read_lines, table_header

Format = Literal["TUM", "KITTI", "table", "euroc", "robotcar", "nclt"] | NamedFormat
#: numbers in a line -> format
COLUMNS: dict[int, Format] = {8: "TUM", 12: "KITTI"}
BY_NAME: tuple[Format, ...] = (*NAMED_FORMATS, "table")
#: how poses of two files are matched, by format
JOINED_BY: dict[str, str] = {
    **dict.fromkeys(("TUM", *RECORDED), "times"), "KITTI": "lines", **dict.fromkeys(BY_NAME, "names of images"),
}  # fmt: skip


@dataclass(frozen=True)
class SegmentErrors:
    """KITTI's relative errors over segments of 100 to 800 m.

    Attributes:
        translation_percent: t_rel, the mean error as a share of the segments' lengths.
        rotation_deg_per_100m: r_rel.
        segments: number of segments.
    """

    translation_percent: float
    rotation_deg_per_100m: float
    segments: int


@dataclass(frozen=True, eq=False)
class TrajectoryComparison:
    """Errors of an estimate, absolute (APE) and relative (RPE), by the definitions of evo and KITTI.

    Attributes:
        reference, estimate: poses of the frames that both have, ``world_from_body``; the estimate as in its file.
        reference_frames, estimate_frames: number of poses in each file.
        length_m: length of the reference's path through the common frames.
        absolute_m: APE in metres by alignment, without alignments that the positions leave undetermined.
        absolute_deg: APE of rotation in degrees, likewise.
        relative_m, relative_deg: RPE from each frame to the next; None for a single frame.
        segments: None if the path is shorter than 100 m.
    """

    reference: Float64[ndarray, "n 4 4"]
    estimate: Float64[ndarray, "n 4 4"]
    reference_frames: int
    estimate_frames: int
    length_m: float
    absolute_m: dict[Alignment, ErrorStatistics]
    absolute_deg: dict[Alignment, ErrorStatistics]
    relative_m: ErrorStatistics | None
    relative_deg: ErrorStatistics | None
    segments: SegmentErrors | None

    def aligned(self, alignment: Alignment) -> Float64[ndarray, "n 4 4"]:
        """The estimate, aligned as ``alignment`` allows.

        Raises:
            ArgumentError: the positions do not determine the alignment.
        """
        if alignment not in self.absolute_m:
            raise ArgumentError(
                f"alignment={alignment}: the positions lie on a line or coincide, so a rotation is undetermined",
                "alignment=none",
            )
        if alignment == "none":
            return self.estimate
        return align(self.reference, self.estimate, scaled=alignment == "similarity")

    def statistics(self) -> list[tuple[str, str, ErrorStatistics]]:
        """All statistics, each with its name and unit."""
        rows = [(f"APE, alignment {name}", "m", each) for name, each in self.absolute_m.items()]
        rows += [(f"APE, alignment {name}", "deg", each) for name, each in self.absolute_deg.items()]
        relative = (("m", self.relative_m), ("deg", self.relative_deg))
        return rows + [("RPE, frame to frame", unit, each) for unit, each in relative if each]

    def facts(self) -> dict[str, Any]:
        """Everything but the poses, as plain values."""
        return {
            "frames": len(self.reference),
            "reference_frames": self.reference_frames,
            "estimate_frames": self.estimate_frames,
            "length_m": self.length_m,
            "absolute_m": {name: asdict(found) for name, found in self.absolute_m.items()},
            "absolute_deg": {name: asdict(found) for name, found in self.absolute_deg.items()},
            "relative_m": self.relative_m and asdict(self.relative_m),
            "relative_deg": self.relative_deg and asdict(self.relative_deg),
            "segments": self.segments and asdict(self.segments),
        }


@checked
def compare_trajectories(
    reference: Path | str, estimate: Path | str, *, max_gap_s: NonNegative = 0.01
) -> TrajectoryComparison:
    """Compare two files of poses, both of TUM, EuRoC, RobotCar or NCLT (by nearest time) or both of KITTI (by line).

    Files of COLMAP, OpenSfM and nerfstudio and tables ``file,x,y,heading`` (degrees; also the ``poses.csv`` that
    localization writes) can be compared with each other; they are matched by image names. A table's cameras look along
    the ground, whose normal is z.

    Args:
        reference, estimate: lines of ``timestamp tx ty tz qx qy qz qw``, or of the 12 numbers of a 3x4 matrix; or a
            table, ``images.txt``, ``images.bin``, ``reconstruction.json``, ``transforms.json``.
        max_gap_s: largest time difference between poses of one frame, in seconds.

    Raises:
        ArgumentError: the gap is negative, or the files have no frame in common.
        UserError: a file cannot be read, the formats differ, or files without times differ in length.

    Example:
        >>> found = compare_trajectories("poses/00.txt", "estimates/00_ORB.txt")  # doctest: +SKIP
        >>> found.absolute_m["rigid"].rmse  # doctest: +SKIP
    """
    given = [(path, pose_format(path)) for path in (reference, estimate)]
    formats = [form for _, form in given]
    if len({JOINED_BY[form] for form in formats}) > 1:
        said = ", ".join(f"{path} ({form}) by {JOINED_BY[form]}" for path, form in given)
        timed = next((each for path, form in given if form == "table" and "TUM" in formats
                      and (each := Path(path).with_name("trajectory.tum")).is_file()), None)  # fmt: skip
        fix = f"Give {timed}, which has times." if timed else "Convert one of them to the format of the other."
        raise UserError(f"these poses cannot be matched: {said}", fix)
    if named := [_named(Path(path), form) for path, form in given if form in BY_NAME]:
        return _compare_named(*named)
    if "KITTI" in formats:
        truth, guess = read_kitti(reference), read_kitti(estimate)
        if len(truth) != len(guess):
            raise UserError(
                f"{reference} has {counted(len(truth), 'pose')} and {estimate} {len(guess):,}; without times they are "
                "matched line by line",
                "Give TUM's format, which has times, or complete the shorter file.",
            )
        return _compare(truth, guess, len(truth), len(guess))
    (times, truth), (own_times, guess) = (
        read_tum_matrices(path) if form == "TUM" else read_recorded(path) for path, form in given
    )
    rows, own_rows = _joined(times, own_times, max_gap_s)
    if not len(rows):
        raise ArgumentError(
            f"max_gap_s={max_gap_s:g}: no two poses are that close in time; {reference} covers {times[0]:.3f} to "
            f"{times[-1]:.3f} s, {estimate} {own_times[0]:.3f} to {own_times[-1]:.3f} s",
            "Use the same clock for both, or a wider gap: max_gap_s=0.05",
        )
    return _compare(truth[rows], guess[own_rows], len(truth), len(guess))


def pose_format(path: Path | str) -> Format:
    """The format of a file of poses, by its name and first line.

    Raises:
        UserError: the file cannot be read, or has no known format.
    """
    if (named := named_format(Path(path))) is not None:
        return named
    lines = read_lines(path, "A file of poses, one per line.")
    if (recorded := recorded_format(table_header(Path(path)))) is not None:
        return recorded
    if {"file", "x", "y"} <= set(table_header(Path(path))):
        return "table"
    first = lines[0][1] if lines else []
    if len(first) not in COLUMNS:
        raise UserError(
            f"{path}: the {len(first)} numbers in its first line are not a pose",
            "8 per line: timestamp tx ty tz qx qy qz qw (TUM), or 12: the rows of a 3x4 matrix (KITTI); or a table "
            "file,x,y,heading; or a file of COLMAP, OpenSfM or nerfstudio.",
        )
    return COLUMNS[len(first)]


def _named(path: Path, form: Format) -> Reconstruction:
    if form in NAMED_FORMATS:
        return read_reconstruction(path, form)
    if {"qw", "qx", "qy", "qz"} <= set(table_header(path)):
        names, poses, _ = read_posed_table(path, unlocated=True)
        return reconstruction_of(path, [PosedImage(*each) for each in zip(names, poses, strict=True)])
    images = []
    for name, row in read_pose_table(path).items():
        if row.heading_deg is None:
            raise UserError(f"{path} has no column heading (degrees)", "file,x,y,heading\nfirst.jpg,12.5,-3.0,90")
        c, s = np.cos(np.radians(row.heading_deg)), np.sin(np.radians(row.heading_deg))
        images.append(PosedImage(name, np.array([[s, 0, c, row.x], [-c, 0, s, row.y], [0, -1, 0, 0], [0, 0, 0, 1.0]])))
    return reconstruction_of(path, images)


def _compare_named(reference: Reconstruction, estimate: Reconstruction) -> TrajectoryComparison:
    rows = estimate.match(reference.names).refuse_ambiguous("images of both files").rows
    both = [(row, own) for row, own in enumerate(rows) if own is not None]
    if not both:
        raise UserError(
            f"no image is in both files: the first has {reference.names[0]}, the second {estimate.names[0]}",
            "Give two files with poses of the same images.",
        )
    here, there = np.array(both).T
    return _compare(reference.poses[here], estimate.poses[there], len(reference.images), len(estimate.images))


def _joined(
    times: Float64[ndarray, "n"], own: Float64[ndarray, "m"], max_gap_s: float
) -> tuple[Int64[ndarray, "k"], Int64[ndarray, "k"]]:
    """Rows of both that are each other's nearest in time."""
    after = np.clip(np.searchsorted(times, own), 1, max(1, len(times) - 1))
    before = after - 1
    after = np.minimum(after, len(times) - 1)
    nearest = np.where(np.abs(times[before] - own) <= np.abs(times[after] - own), before, after)
    gaps = np.abs(times[nearest] - own)
    best: dict[int, int] = {}
    for row, reference in enumerate(nearest.tolist()):
        if gaps[row] <= max_gap_s and (reference not in best or gaps[row] < gaps[best[reference]]):
            best[reference] = row
    return np.array(list(best), np.int64), np.array(list(best.values()), np.int64)


def _compare(
    truth: Float64[ndarray, "n 4 4"], guess: Float64[ndarray, "n 4 4"], count: int, own_count: int
) -> TrajectoryComparison:
    alignments: tuple[Alignment, ...] = ("none", "rigid", "similarity")
    metres, degrees = dict[Alignment, ErrorStatistics](), dict[Alignment, ErrorStatistics]()
    for alignment in alignments:
        try:
            metres[alignment] = ErrorStatistics.of(absolute_errors(truth, guess, alignment=alignment))
        except ValueError:
            continue
        turned = absolute_errors(truth, guess, alignment=alignment, part="rotation_deg")
        degrees[alignment] = ErrorStatistics.of(turned)
    relative = relative_deg = None
    if len(truth) > 1:
        relative = ErrorStatistics.of(relative_errors(truth, guess))
        relative_deg = ErrorStatistics.of(relative_errors(truth, guess, part="rotation_deg"))
    shares, turns = segment_errors(truth, guess)
    segments = (
        SegmentErrors(100 * float(shares.mean()), 100 * float(turns.mean()), len(shares)) if len(shares) else None
    )
    length = float(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum())
    return TrajectoryComparison(
        truth, guess, count, own_count, length, metres, degrees, relative, relative_deg, segments
    )
