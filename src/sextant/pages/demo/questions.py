"""The questions that the page can ask, and the functions that answer them. Heavy: imported only for a question."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.errors import UserError
from sextant.tools.demonstration.digit import DigitTrial
from sextant.tools.demonstration.photo import photo_answer
from sextant.tools.demonstration.pictures import page_picture
from sextant.tools.demonstration.same_place import SamePlace
from sextant.tools.demonstration.where_else import Point, where_else_answer

calibrator, same_place, digit_trial = cache(PhotoCalibrator.load), cache(SamePlace.load), cache(DigitTrial.load)


def _example(paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
    points = [_point(word) for word in settings.get("points", "").split(";") if word]
    return where_else_answer(paths, points, turned="turned" in settings, resized="resized" in settings)


def _point(word: str) -> Point:
    try:
        number, x, y = word.split(",")
        return int(number), float(x), float(y)
    except ValueError:
        raise UserError(f"points={word} is no point", "Point into one of the photos.") from None


def _digit(paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
    if paths:
        return digit_trial().answer(*paths)
    try:
        return digit_trial().of_scan(int(settings.get("digit", "")))
    except ValueError:
        raise UserError("there is no digit to look at", "Draw one, choose a picture, or choose a sample.") from None


#: question -> minimum and maximum number of files, and the function that answers
QUESTIONS: dict[str, tuple[int, int, Callable[[Sequence[Path], Mapping[str, str]], dict[str, Any]]]] = {
    "photo": (1, 1, lambda paths, _: photo_answer(calibrator(), *paths)),
    "picture": (1, 1, lambda paths, _: page_picture(*paths)),
    "places": (2, 2, lambda paths, _: same_place().answer(*paths)),
    "example": (1, 2, _example),
    "digit": (0, 1, _digit),
}
