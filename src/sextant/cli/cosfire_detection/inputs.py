"""The example and the images of a detection; imports nothing heavier than Pillow."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from sextant.applications.detection.options import check_point
from sextant.cli.cosfire_detection.options import DetectionOptions
from sextant.data.photo_files import find_photos
from sextant.data.upright import upright_size
from sextant.errors import UserError


@dataclass(frozen=True)
class DetectionInputs:
    """What is looked for, and where.

    Attributes:
        prototype: the example.
        paths: of the images.
        output: folder for what is found.
        options: chosen by the user.
    """

    prototype: Path
    paths: list[Path]
    output: Path
    options: DetectionOptions


def read_inputs(given: Mapping[str, str]) -> DetectionInputs:
    """What the arguments name.

    Raises:
        UserError: an option has no meaning, there is no such prototype or no image, or the point lies outside.
    """
    options, output = DetectionOptions.of(given), Path(given["output"]).expanduser()
    prototype = Path(given["prototype"]).expanduser()
    if not prototype.is_file():
        what = "is a folder, not one image" if prototype.is_dir() else "there is no such file"
        raise UserError(f"prototype={given['prototype']}: {what}", "Give one image that shows what is looked for.")
    size = _upright_size(prototype)
    if options.point is not None and size is not None:
        check_point(options.point, size)
    return DetectionInputs(prototype, find_photos(given["input"], output), output, options)


def _upright_size(path: Path) -> tuple[int, int] | None:
    """Width and height by the header; None if it cannot be read, which is reported when the image is decoded."""
    try:
        with Image.open(path) as image:
            return upright_size(image)
    except Exception:  # decoders raise almost anything on broken files
        return None
