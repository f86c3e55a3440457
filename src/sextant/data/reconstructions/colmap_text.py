"""COLMAP's ``images.txt`` and ``cameras.txt``.

An image takes two lines, ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`` and its points, ``X Y POINT3D_ID`` each; the
quaternion and the translation are ``camera_from_world``, with x right, y down and z forward. The second line may be
empty, and programs that write poses alone leave it out: it is recognised by its content. A camera is a line ``CAMERA_ID
MODEL WIDTH HEIGHT PARAMS[]``. Lines that start with # are comments. Source: COLMAP's documentation, "Output Format".
"""

from collections.abc import Sequence
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
from sextant.user_files import read_lines, read_text

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
    follows = False  # an image, whose points may come
    for number, line in enumerate(read_text(path, FIX).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if follows and _are_points(line.split()):
            follows = False
            continue
        follows = True
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
    for number, words in read_lines(path, FIX):
        numbers = finite([words[2], words[3], *words[4:]], len(words) - 2) if len(words) > 4 else None
        if numbers is None:
            begins = " ".join(words)[:40]
            raise UserError(f"{path}, line {number}: not CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]: {begins}", FIX)
        found[words[0]] = lens_of(words[1], int(numbers[0]), int(numbers[1]), float(numbers[2]))
    return found


def _are_points(words: Sequence[str]) -> bool:
    """Whether a line consists of points, each two finite numbers and a whole one, and is no image without its name."""
    numbers = finite(words, len(words))
    if numbers is None or len(words) % 3 or any(not word.removeprefix("-").isdecimal() for word in words[2::3]):
        return False
    return len(words) != 9 or rotation_of(numbers[1:5]) is None
