"""The output of localization: a trajectory, a table, a picture and an animation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from sextant.atomic_files import write_csv
from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.map_pictures import thumbnail
from sextant.errors import ArgumentError
from sextant.tables import counted

if TYPE_CHECKING:
    from sextant.chapters.localization.figures.particles import ParticleFrame

COLUMNS = (
    "file", "x", "y", "heading_deg", "sigma_x", "sigma_y", "sigma_heading_deg", "mass", "modes", "lost", "error",
    "off_map", "foreseen", "recognised",
)  # fmt: skip
TABLE, TRAJECTORY, SMOOTHED = "poses.csv", "trajectory.tum", "smoothed.tum"
PICTURE = "trajectory.png"
#: most frames of an animation; for a longer run every second frame is shown, or every fourth, ...
MOST_FRAMES = 600
LOST = "#a02020"


@dataclass(frozen=True, eq=False)
class Row:
    """One image and the estimate after it."""

    name: str
    told: LocalizedPose
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Moment:
    """A step as it is drawn.

    Attributes:
        step: its number.
        row: the image and the estimate.
        poses, log_weights: the particles.
        seen: the image, small; None if there was none.
        there: the map's image nearest to the estimate, small; None while lost, or if the map has no pictures.
    """

    step: int
    row: Row
    poses: Float32[ndarray, "p 3"]
    log_weights: Float32[ndarray, " p"]
    seen: UInt8[ndarray, "h w c"] | None = None
    there: UInt8[ndarray, "h w c"] | None = None

    @classmethod
    def of(cls, step: int, row: Row, localizer: Localizer, seen: UInt8[ndarray, "h w c"] | None) -> Self:
        """The state of a localizer after a step."""
        belief, told = localizer.belief, row.told
        return cls(
            step,
            row,
            belief.poses[0].numpy().astype(np.float32),
            belief.log_weights[0].numpy().astype(np.float32),
            None if seen is None else thumbnail(seen),
            None if told.lost else localizer.picture_near(told.pose),
        )

    def drawn(self) -> "ParticleFrame":
        """The frame that :mod:`sextant.chapters.localization.figures` draws."""
        from sextant.chapters.localization.figures.particles import ParticleFrame

        told, problem = self.row.told, self.row.problem
        return ParticleFrame(
            self.poses.astype(np.float64),
            np.maximum(self.log_weights.astype(np.float64), -1e6),
            None if told.lost else told.pose,
            title=f"{self.row.name}{', lost' if told.lost else ''}{f', {problem}' if problem else ''}",
            covariance=told.covariance[:2, :2],
            seen=self.seen,
            there=self.there,
        )


@dataclass
class Replay:
    """The steps to animate: at most :data:`MOST_FRAMES`, evenly spaced, however long the run is."""

    kept: list[Moment] = field(default_factory=list)
    stride: int = 1

    def add(self, moment: Moment) -> None:
        """Add a step."""
        if moment.step % self.stride:
            return
        self.kept.append(moment)
        if len(self.kept) > MOST_FRAMES:
            self.stride *= 2
            self.kept = [each for each in self.kept if each.step % self.stride == 0]

    def write(self, positions: Float64[ndarray, "n 2"], path: Path, unit: str = "m") -> None:
        """Write the animation; ``unit`` is the unit of positions.

        Raises:
            UserError: OpenCV cannot write MP4 here.
        """
        from sextant.chapters.localization.figures.particles import particle_replay

        seen = any(moment.seen is not None for moment in self.kept)
        particle_replay(positions, (moment.drawn() for moment in self.kept), path, unit=unit, seen=seen)


def refuse_to_replace_poses(
    output: Path, *, smooth: bool = False, replay: str = "mp4", **read: Path | str | None
) -> None:
    """Check that no file of the user's is in the place of one that localizing writes.

    A table of ground-truth poses is called ``poses.csv`` too, and files without our table beside them are not ours.

    Args:
        output: folder of the results, which need not exist.
        smooth: ``smoothed.tum`` is written too.
        replay: the animation that is written: ``mp4`` (``gif`` where OpenCV cannot), ``gif`` or ``none``.
        read: files that are read, by their key; anything but a file is ignored.

    Raises:
        ArgumentError: a file would be replaced.
    """
    fix = f"Choose a separate folder: output={output / 'localized'}"
    replays = [f"replay.{kind}" for kind in ("mp4", "gif") if replay in ("mp4", kind)]
    names = (TABLE, TRAJECTORY, PICTURE, *[SMOOTHED] * smooth, *replays)
    table, *others = written = [output / name for name in names]
    for key, given in read.items():
        path = Path(given or "").expanduser()
        if path.is_file() and any(each.exists() and each.samefile(path) for each in written):
            raise ArgumentError(f"{key}={given} is a file that output={output} would replace", fix)
    try:
        head = table.read_text(encoding="utf-8", errors="replace").partition("\n")[0]
    except OSError:
        foreign = next((each for each in others if each.exists()), None)
    else:
        foreign = None if head.startswith(",".join(COLUMNS[:5])) else table
    if foreign is not None:
        raise ArgumentError(f"output={output}: {foreign} was not written by a localizer, and would be replaced", fix)


def write_poses(rows: Sequence[Row], times_s: Float64[ndarray, "n"], output: Path) -> None:
    """Write ``poses.csv`` and ``trajectory.tum``, a row per image."""
    lines = []
    for row in rows:
        told, (sx, sy, sh) = row.told, row.told.sigmas.tolist()
        x, y, heading = told.pose.tolist()
        values = (x, y, np.degrees(heading), sx, sy, np.degrees(sh), told.mass)
        named = dict(zip(COLUMNS[1:8], (f"{value:.6f}" for value in values), strict=True))
        said = {"modes": told.modes, "lost": told.lost, "error": row.problem}
        shares = {"off_map": f"{told.off_map:.6f}", "foreseen": f"{told.foreseen:.6f}"}
        shares["recognised"] = f"{told.recognised:.6f}"
        lines.append({"file": row.name, **named, **said, **shares})
    write_csv(output / TABLE, COLUMNS, lines)
    write_tum(output / TRAJECTORY, times_s, np.stack([row.told.pose for row in rows]))


def draw_trajectory(rows: Sequence[Row], positions: Float64[ndarray, "n 2"], output: Path, unit: str = "m") -> None:
    """Draw ``trajectory.png``: the path over the map; where the localizer reports that it is lost, unconnected dots."""
    from sextant.chapters.localization.figures.particles import ESTIMATE, draw_map, map_height
    from sextant.figures.style import new_figure, save_figure

    figure, (axes,) = new_figure(6.0, map_height(positions, 6.0))
    draw_map(axes, positions, unit)
    way = np.stack([row.told.pose[:2] for row in rows])
    lost = np.array([row.told.lost for row in rows])
    known = np.where(lost[:, None], np.nan, way)
    if lost.any():
        axes.plot(
            way[lost, 0],
            way[lost, 1],
            "x",
            color=LOST,
            markersize=4,
            label=f"lost ({counted(int(lost.sum()), 'image')})",
        )
    if (found := np.flatnonzero(~lost)).size:
        axes.plot(*known.T, "-", color=ESTIMATE, linewidth=1.4, marker=".", markersize=3, label="localized")
        axes.plot(*way[found[0]], "o", color=ESTIMATE, markeredgecolor="white", markersize=7, label="first")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=7)
    save_figure(figure, output, "trajectory")
