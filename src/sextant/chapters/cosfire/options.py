"""Options and inputs of detection from one example; imports nothing heavier than Pillow."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field

from sextant.applications.arguments import check_apart
from sextant.chapters.cosfire.detector_options import LONGEST, MAX_DETECTIONS, Preset, check_point
from sextant.console.arguments import SPLIT, Options
from sextant.data.photo_files import find_photos
from sextant.data.picture_files import open_picture
from sextant.data.upright import upright_size
from sextant.errors import UserError
from sextant.user_files import absent

PROTOTYPE = {"prototype": "the example image from which the filter is configured"}


class DetectionOptions(Options):
    """What the user chose; None leaves the choice to the filter."""

    point: Annotated[tuple[float, float], SPLIT] | None = Field(
        None, title="two numbers, x,y in pixels", examples=["120,80"]
    )
    """x,y of the pattern to detect, in pixels of the upright prototype (default: its centre)"""
    preset: Preset | None = Field(None, examples=["photo"])
    """filter parameters: photo (edges; default), bifurcation, symbol, digit or traffic_sign"""
    layer: str | None = None
    """with run=: the network layer whose features the filter uses, instead of those of a preset"""
    rotations: int | None = Field(None, ge=1, le=360, examples=[8])
    """number of evenly spaced orientations to detect (default: the preset's, or 1)"""
    scales: Annotated[tuple[Annotated[float, Field(gt=0)], ...], SPLIT] | None = Field(
        None, min_length=1, title="numbers above 0, separated by commas", examples=["0.7,1,1.4"]
    )
    """sizes to detect, relative to the example, such as 0.7,1,1.4 (default: the preset's, or 1)"""
    reflection: bool | None = Field(None, examples=["true"])
    """true: also detect mirror images of the example"""
    threshold: float | None = Field(None, gt=0, le=1, examples=[0.7])
    """minimum score of a detection, relative to the filter's response to its prototype (default: 0.7; 0.8 with
    run=)"""
    min_distance: float | None = Field(None, gt=0, examples=[20])
    """distance in pixels within which detections are merged (default: the filter's radius)"""
    max_detections: int = Field(MAX_DETECTIONS, ge=1, examples=[8])
    """maximum number of detections per image; the strongest are kept (default: 100)"""
    longest: int = Field(LONGEST, ge=16, examples=[1200])
    """longest side in pixels; larger images and prototypes are shrunk to it (default: 800)"""

    @classmethod
    def of(cls, given: Mapping[str, str], usage: str | None = None) -> Self:
        """Read the values of these keys.

        Raises:
            UserError: as for all options; or an option is incompatible with ``run=``, or needs it.
        """
        if "preset" in given and "run" in given:
            raise UserError(
                "preset= and run= exclude each other: the filter uses either a preset's bank or a network",
                "Leave one of them out.",
            )
        if "layer" in given and "run" not in given:
            raise UserError(
                "layer= needs the network of run=, which is missing", "run=<run of classification or place_recognition>"
            )
        return super().of(given, usage)


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
        raise UserError(f"prototype={what}", "Give one image that shows the pattern to detect.")
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
