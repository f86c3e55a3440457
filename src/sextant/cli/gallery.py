"""``sextant data gallery``: pictures of the worlds."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from sextant.cli.arguments import parse_arguments
from sextant.cli.console import console
from sextant.errors import UserError

USAGE = "sextant data gallery [folder=gallery] [samples=16] [sections=streets,office]"
KEYS = {
    "folder": "where the pictures go; gallery unless given",
    "samples": "rays a pixel, a square number from 1 to 64; 16 unless given",
    "sections": "streets, conditions, panoramas, from_above, office; all unless given",
}


def gallery(arguments: Sequence[str]) -> None:
    """Render the gallery, showing each section's files as they are written."""
    options = {"folder": "gallery", "samples": "16", "sections": ""} | parse_arguments(arguments, KEYS, USAGE)
    if options["samples"] not in {str(side * side) for side in range(1, 9)}:
        raise UserError(f"samples={options['samples']} must be a square number from 1 to 64", "For example samples=16")
    from sextant.data.worlds.gallery import SECTIONS, render_gallery

    sections = [name for name in options["sections"].split(",") if name] or list(SECTIONS)
    for name in sections:
        if name not in SECTIONS:
            raise UserError(f"sections={name}: there is no such section", f"Choose among {', '.join(SECTIONS)}.")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("gallery", total=len(sections))

        def done(paths: list[Path]) -> None:
            progress.advance(task)
            for path in paths:
                progress.console.print(escape(str(path)))

        render_gallery(Path(options["folder"]), int(options["samples"]), sections, done)
