"""The example and the images of a detection; imports nothing heavier than Pillow."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sextant.applications.arguments import check_apart
from sextant.chapters.cosfire.cli.options import DetectionOptions
from sextant.chapters.cosfire.detector_options import check_point
from sextant.data.photo_files import find_photos
from sextant.data.picture_files import open_picture
from sextant.data.upright import upright_size
from sextant.errors import UserError
from sextant.user_files import absent


@dataclass(frozen=True)
class DetectionInputs:
    """The example to detect, and the images to search.

    Attributes:
        prototype: path of the example.
        paths: paths of the images.
        output: folder for the results.
        options: options chosen by the user.
    """

    prototype: Path
    paths: list[Path]
    output: Path
    options: DetectionOptions


def read_inputs(given: Mapping[str, str]) -> DetectionInputs:
    """Read the inputs from the arguments.

    Raises:
        UserError: an option is invalid, the prototype does not exist, there is no image, or the point lies outside.
    """
    options, output = DetectionOptions.of(given), Path(given["output"]).expanduser()
    prototype = Path(given["prototype"]).expanduser()
    if not prototype.is_file():
        what = f"{prototype} is a folder, not one image" if prototype.is_dir() else absent(prototype)
        raise UserError(f"prototype={what}", "Give one image that shows what is looked for.")
    size = _upright_size(prototype)
    if options.point is not None and size is not None:
        check_point(options.point, size)
    paths = find_photos(given["input"], output)
    check_apart(output, [prototype, *paths], input=given["input"])
    return DetectionInputs(prototype, paths, output, options)


def _upright_size(path: Path) -> tuple[int, int] | None:
    """Width and height from the header; None if it is unreadable, which is reported when the image is decoded."""
    try:
        with open_picture(path) as image:
            return upright_size(image)
    except Exception:  # decoders can raise almost anything on broken files
        return None
