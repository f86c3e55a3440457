"""Detect which program wrote a file, and read its poses."""

from pathlib import Path
from typing import Literal, get_args

from sextant.data.reconstructions.colmap import read_colmap_binary, read_colmap_text
from sextant.data.reconstructions.nerfstudio import read_nerfstudio
from sextant.data.reconstructions.opensfm import read_opensfm
from sextant.data.reconstructions.reconstruction import Reconstruction

#: formats whose poses belong to named images
NamedFormat = Literal["colmap", "opensfm", "nerfstudio"]
NAMED_FORMATS: tuple[NamedFormat, ...] = get_args(NamedFormat)
#: bytes that suffice to distinguish the JSON formats
HEAD = 4096


def read_reconstruction(path: Path, format: NamedFormat) -> Reconstruction:
    """Read the posed images of a file.

    Args:
        path: ``images.txt`` or ``images.bin`` of COLMAP, ``reconstruction.json`` of OpenSfM, ``transforms.json`` of
            nerfstudio.
        format: of the file, see :func:`named_format`.

    Raises:
        UserError: it cannot be read, or has an invalid pose.
    """
    if format == "colmap":
        return read_colmap_binary(path) if path.suffix == ".bin" else read_colmap_text(path)
    return read_opensfm(path) if format == "opensfm" else read_nerfstudio(path)


def named_format(path: Path) -> NamedFormat | None:
    """The format of a file of named poses, by its name and beginning; None if it is none of them or unreadable."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD).decode("utf-8-sig", "replace").lstrip()
    except OSError:
        return None
    if path.suffix == ".bin":
        return "colmap" if path.name == "images.bin" else None
    if path.suffix == ".json":
        return "opensfm" if head.startswith("[") else "nerfstudio" if head.startswith("{") else None
    lines = (line for line in head.splitlines() if line.strip())
    first = next((line.split(maxsplit=9) for line in lines if not line.lstrip().startswith("#")), [])
    named = len(first) == 10 and first[0].isdecimal() and first[8].isdecimal()
    return "colmap" if named and not _number(first[9]) else None


def _number(text: str) -> bool:
    try:
        float(text.split(maxsplit=1)[0])
    except ValueError:
        return False
    return True
