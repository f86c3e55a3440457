"""COLMAP's ``images.txt`` and ``cameras.txt``.

An image takes two lines, ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`` and its points, a line that may be empty; the
quaternion and the translation are ``camera_from_world``, with x right, y down and z forward. A camera is a line
``CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]``. Lines that start with # are comments. Source: COLMAP's documentation, "Output
Format".
"""

from pathlib import Path

from sextant.data.reconstructions.colmap_models import lens_of
from sextant.data.reconstructions.reconstruction import (
    Lens,
    PosedImage,
    Reconstruction,
    finite,
    inverted,
    reconstruction_of,
    rotation_of,
    unusable,
)
from sextant.errors import UserError

FIX = "Export the model as text again: colmap model_converter --output_type TXT"


def read_colmap_text(path: Path) -> Reconstruction:
    """Read the images of ``images.txt``; lenses are those of ``cameras.txt`` beside it, if it exists.

    Raises:
        UserError: a file cannot be read, or a line is not of this format; the message names it.
    """
    cameras = path.with_name("cameras.txt")
    lenses = _lenses(cameras) if cameras.is_file() else {}
    images: list[PosedImage] = []
    problems: list[str] = []
    lines = enumerate(_lines(path), start=1)
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        next(lines, None)  # its points
        words = line.split(maxsplit=9)
        values = finite(words[1:8], 7) if len(words) == 10 and words[0].isdecimal() else None
        if values is None:
            problems.append(f"line {number}: not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME: {line[:40]}")
        elif (rotation := rotation_of(values[:4])) is None:
            problems.append(f"line {number}: the quaternion has not length 1")
        else:
            pose = inverted(rotation, values[4:])
            images.append(PosedImage(words[9].strip(), pose, lenses.get(words[8])))
    if problems:
        raise unusable(path, problems, FIX)
    return reconstruction_of(path, images)


def _lenses(path: Path) -> dict[str, Lens]:
    found: dict[str, Lens] = {}
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        numbers = finite([words[2], words[3], *words[4:]], len(words) - 2) if len(words) > 4 else None
        if numbers is None:
            raise UserError(f"{path}, line {number}: not CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]: {line[:40]}", FIX)
        found[words[0]] = lens_of(words[1], int(numbers[0]), int(numbers[1]), float(numbers[2]))
    return found


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path} cannot be read: {error}", FIX) from None
