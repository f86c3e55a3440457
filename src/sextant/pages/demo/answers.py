"""Answers for the page: from uploaded files and settings to plain values."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.resources import files as files_of
from pathlib import Path
from threading import Lock
from typing import Any

from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.errors import UserError
from sextant.tables import counted
from sextant.tools.demonstration.digit import DigitTrial
from sextant.tools.demonstration.photo import photo_answer
from sextant.tools.demonstration.pictures import page_picture
from sextant.tools.demonstration.posed_office import SAMPLES as OFFICE_SAMPLES
from sextant.tools.demonstration.same_place import SamePlace
from sextant.tools.demonstration.where_else import Point, where_else_answer
from sextant.tools.demonstration.where_taken import OFFICE, WhereTaken

calibrator, same_place, digit_trial = cache(PhotoCalibrator.load), cache(SamePlace.load), cache(DigitTrial.load)

#: the maps in which photos are located, by key; the command adds the user's as ``given``
MAPS: dict[str, Callable[[], WhereTaken]] = {"office": cache(WhereTaken.in_office)}


def _example(paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
    points = [_point(word) for word in settings.get("points", "").split(";") if word]
    return where_else_answer(paths, points, turned="turned" in settings, resized="resized" in settings)


def _point(word: str) -> Point:
    try:
        number, x, y = word.split(",")
        return int(number), float(x), float(y)
    except ValueError:
        raise UserError(f"points={word} is not a point", "Click in one of the photos.") from None


def _digit(paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
    if paths:
        return digit_trial().answer(*paths)
    try:
        return digit_trial().of_scan(int(settings.get("digit", "")))
    except ValueError:
        raise UserError("there is no digit to read", "Draw one, choose a picture, or choose a sample.") from None


def maps() -> list[dict[str, Any]]:
    """The maps to choose from, the user's first, and the photos that can be tried in them."""
    given = [{"key": key, "name": load().name, "samples": ()} for key, load in MAPS.items() if key != "office"]
    return [*given, {"key": "office", "name": OFFICE, "samples": OFFICE_SAMPLES}]


def _taken(paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
    key, same = settings.get("map", "office"), "same_camera" in settings
    if key not in MAPS:
        raise UserError(f"map={key}: there is no such map", f"There are: {', '.join(MAPS)}")
    where = MAPS[key]()
    return where.answer(paths[0], same) if paths else where.of_sample(settings.get("sample", ""), same)


#: question -> minimum and maximum number of files, and the function that answers
QUESTIONS: dict[str, tuple[int, int, Callable[[Sequence[Path], Mapping[str, str]], dict[str, Any]]]] = {
    "photo": (1, 1, lambda paths, _: photo_answer(calibrator(), *paths)),
    "picture": (1, 1, lambda paths, _: page_picture(*paths)),
    "places": (2, 2, lambda paths, _: same_place().answer(*paths)),
    "example": (1, 2, _example),
    "digit": (0, 1, _digit),
    "taken": (0, 1, _taken),
}


#: a folder in memory, so that dropped files never reach a disk; where it is missing or full, the default folder for
#: temporary files is used instead
MEMORY = Path("/dev/shm")
SAMPLES = ("china.jpg", "flower.jpg")
_one_at_a_time = Lock()


def prepare() -> None:
    """Load what the first questions need, while the user is choosing a photo."""
    for load in (calibrator, same_place, digit_trial):
        with _one_at_a_time, suppress(UserError):  # a question may come in between; it reports any error
            load()


def answer(question: str, files: Sequence[tuple[str, bytes]], settings: Mapping[str, str]) -> dict[str, Any]:
    """Answer one of :data:`~sextant.pages.demo.answers.QUESTIONS`; questions are answered one at a time.

    Files exist only while their question is answered. Messages use the names under which they were uploaded.

    >>> found = answer("photo", [("house.jpg", content)], {})  # doctest: +SKIP
    >>> print(found["verdict"], found["reasons"])  # doctest: +SKIP

    Args:
        question: name of the question.
        files: names and contents.
        settings: settings of the question.

    Raises:
        UserError: there is no such question, files are missing or cannot be used, or a setting is wrong.
    """
    if question not in QUESTIONS:
        raise UserError(f"{question}: no such question", f"There are: {', '.join(QUESTIONS)}")
    least, most, ask = QUESTIONS[question]
    if not least <= len(files) <= most:
        wanted = f"{least}" if least == most else f"{least} to {most}"
        raise UserError(
            f"{counted(len(files), 'file was', 'files were')} sent; {wanted} needed", "Choose or drop a photo first."
        )
    with _one_at_a_time, _stored(files) as paths:
        return ask(paths, settings)


def sample_photo(name: str) -> bytes:
    """One of the two photos that come with scikit-learn.

    Raises:
        UserError: there is none of that name.
    """
    if name not in SAMPLES:
        raise UserError(f"{name}: no such sample", f"There are: {', '.join(SAMPLES)}")
    return (files_of("sklearn.datasets.images") / name).read_bytes()


@contextmanager
def _stored(files: Sequence[tuple[str, bytes]]) -> Iterator[list[Path]]:
    """Store files with these contents while the block runs; errors in the block use the user's file names."""
    with ExitStack() as stack:
        try:
            try:
                paths = stack.enter_context(_stored_in(MEMORY, files))
            except OSError:
                paths = stack.enter_context(_stored_in(None, files))
        except OSError as error:
            raise UserError(
                f"there is no room for a temporary file: {error.strerror}",
                "Free some space, or start sextant demo with TMPDIR=<a folder that has some>.",
            ) from None
        try:
            yield paths
        except UserError as error:
            problem, fix = error.problem, error.fix or ""
            for path, (name, _) in zip(paths, files, strict=True):
                problem, fix = (text.replace(str(path), name or "the picture") for text in (problem, fix))
            raise UserError(problem, fix or None) from None


@contextmanager
def _stored_in(place: Path | None, files: Sequence[tuple[str, bytes]]) -> Iterator[list[Path]]:
    with tempfile.TemporaryDirectory(prefix="sextant-", dir=place) as folder:
        paths = [Path(folder, f"{number}{_suffix(name)}") for number, (name, _) in enumerate(files)]
        for path, (_, content) in zip(paths, files, strict=True):
            path.write_bytes(content)
        yield paths


def _suffix(name: str) -> str:
    suffix = Path(name).suffix
    return suffix if suffix[1:].isascii() and suffix[1:].isalnum() and len(suffix) < 8 else ""
