"""``sextant data gallery``: pictures of the worlds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from sextant.console.arguments import SPLIT, Options, UserPath
from sextant.console.console import console
from sextant.console.work_progress import work_progress
from sextant.console.written import make_output
from sextant.errors import UserError

USAGE = "sextant data gallery [folder=gallery] [samples=16] [sections=streets,office]"


def _square(samples: int) -> int:
    if samples not in (1, 4, 9, 16, 25, 36, 49, 64):
        raise ValueError("not a square number")
    return samples


class GalleryOptions(Options):
    """What the user chose."""

    folder: UserPath = Path("gallery")
    """folder for the pictures (default: gallery)"""
    samples: Annotated[int, AfterValidator(_square)] = Field(16, title="a square number from 1 to 64", examples=[16])
    """rays per pixel, a square number from 1 to 64 (default: 16)"""
    sections: Annotated[tuple[str, ...], SPLIT] = Field((), examples=["streets"])
    """streets, conditions, panoramas, from_above, office (default: all)"""


def gallery(arguments: Sequence[str]) -> None:
    """Render the gallery, showing each section's files as they are written."""
    options = GalleryOptions.parse(arguments, USAGE)
    from sextant.data.worlds.gallery import SECTIONS, render_gallery

    sections = list(options.sections or SECTIONS)
    for name in sections:
        if name not in SECTIONS:
            raise UserError(f"sections={name}: there is no such section", f"Choose among {', '.join(SECTIONS)}.")
    make_output(options.folder, "folder")
    with work_progress("gallery", "sections") as progress:
        progress(0, len(sections))
        for number, name in enumerate(sections, start=1):
            render_gallery(options.folder, options.samples, [name], _written)
            progress(number, len(sections))


def _written(paths: list[Path]) -> None:
    console.print("\n".join(map(str, paths)), markup=False, soft_wrap=True)
