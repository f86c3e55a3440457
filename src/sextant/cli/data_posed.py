"""``sextant data posed``: a rendered office as photos with poses, to try ``sextant locate``."""

from collections.abc import Sequence
from pathlib import Path

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.console.work_progress import work_progress
from sextant.console.written import make_output
from sextant.errors import command

USAGE = "sextant data posed [folder=posed_office]"


class PosedOptions(Options):
    """What the user chose."""

    folder: UserPath = Path("posed_office")
    """folder for map/ with poses.csv, photos/ to locate and truth.csv (default: posed_office)"""


def posed(arguments: Sequence[str]) -> None:
    """Render the office, and print the command that locates its photos."""
    options = PosedOptions.parse(arguments, USAGE)
    from sextant.tools.demonstration.posed_office import camera, render_posed_office

    make_output(options.folder, "folder")
    with work_progress("rendering", "images") as progress:
        render_posed_office(options.folder, progress)
    fx, fy, cx, cy = camera()
    words = (
        f"map={options.folder / 'map'}",
        f"input={options.folder / 'photos'}",
        f"camera={fx:.2f},{fy:.2f},{cx},{cy}",
    )
    console.print(f"to locate the photos: {command('locate', *words)}", markup=False, soft_wrap=True)
