"""``sextant trajectory``: compare an estimated trajectory with its reference."""

import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from pydantic import Field
from rich.table import Table

from sextant.applications.arguments import check_own_file
from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.errors import UserError
from sextant.tables import counted

USAGE = (
    "sextant trajectory <reference> <estimate> [max_gap_s=0.01] [figure=plan.png] [alignment=rigid] [json=errors.json]"
)
PICTURES = (".png", ".svg", ".pdf")


class TrajectoryOptions(Options):
    """What the user chose, apart from the two files (TUM, KITTI, table, COLMAP, OpenSfM, nerfstudio)."""

    max_gap_s: float = Field(0.01, ge=0)
    """largest time difference, in seconds, at which poses of two TUM files correspond (default: 0.01)"""
    figure: UserPath | None = None
    """file for a plan view of both trajectories (.png, .svg or .pdf)"""
    alignment: Literal["none", "rigid", "similarity"] = "none"
    """alignment of the estimate in the figure: none (default), rigid or similarity"""
    json_file: UserPath | None = Field(None, alias="json")
    """JSON file for all statistics"""


def main(arguments: Sequence[str]) -> None:
    """Show absolute and relative errors as defined by evo and KITTI."""
    files = [argument for argument in arguments if "=" not in argument and argument not in ("-h", "--help")]
    options = TrajectoryOptions.parse([argument for argument in arguments if argument not in files], USAGE)
    if len(files) != 2:
        raise UserError(f"trajectory needs two files, got {len(files)}", USAGE)
    if options.figure is None and "alignment" in options.model_fields_set:
        raise UserError(f"alignment={options.alignment} applies to the picture, but figure= is missing", USAGE)
    for key, path, endings in (("figure", options.figure, PICTURES), ("json", options.json_file, (".json",))):
        if path is not None:
            check_own_file(key, path, files, endings)

    from sextant.atomic_files import write_json
    from sextant.chapters.localization.trajectories import compare_trajectories

    found = compare_trajectories(files[0], files[1], max_gap_s=options.max_gap_s)
    console.print(
        f"{counted(len(found.reference), 'frame')} in both, of {found.reference_frames:,} and "
        f"{found.estimate_frames:,}; {found.length_m:,.1f} m"
    )
    alone = min(found.reference_frames, found.estimate_frames) - len(found.reference)
    if alone > len(found.reference):
        console.print(
            f"{counted(alone, 'pose')} of the shorter file {'has' if alone == 1 else 'have'} no counterpart in the "
            f"other and {'is' if alone == 1 else 'are'} excluded from these errors. Poses of TUM files correspond if "
            f"their times differ by at most max_gap_s={options.max_gap_s:g}."
        )
    table = Table("error", "", "rmse", "mean", "median", "max")
    for name, unit, each in found.statistics():
        table.add_row(name, unit, *(f"{value:.4g}" for value in (each.rmse, each.mean, each.median, each.max)))
    console.print(table)
    if found.segments:
        shown, turned = found.segments.translation_percent, found.segments.rotation_deg_per_100m
        told = f"t_rel {shown:.3g} %, r_rel {turned:.3g} deg/100 m"
        console.print(f"KITTI: {told} ({found.segments.segments:,} segments of 100 to 800 m)")
    if options.json_file:
        with _telling("json", options.json_file):
            write_json(options.json_file, found.facts())
    if options.figure:
        from sextant.chapters.localization.figures.trajectories import trajectory_plan
        from sextant.figures.style import save_figure

        path = options.figure
        figure = trajectory_plan(found.reference[:, :3, 3], found.aligned(options.alignment)[:, :3, 3])
        with _telling("figure", path):
            save_figure(figure, path.parent, path.stem, (path.suffix[1:],))


@contextmanager
def _telling(key: str, path: Path) -> Iterator[None]:
    """Turn file errors within the block into one message about the file that a key names."""
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        yield
    except OSError as error:
        problem = f"{key}={path} cannot be written: {error.strerror or error}"
        raise UserError(problem, f"Name a file in a folder that you may write to: {key}=/path/{path.name}") from None
