"""What the page can ask: uploaded files and settings in, plain values out."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from importlib.resources import files as files_of
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.applications.calibration.calibrator import PhotoCalibrator
    from sextant.applications.demonstration.digit import DigitTrial
    from sextant.applications.demonstration.same_place import SamePlace
    from sextant.applications.demonstration.where_else import Point

#: a folder in memory, so that what is dropped never reaches a disk; where there is none, it is deleted from disk
MEMORY = Path("/dev/shm")
SAMPLES = ("china.jpg", "flower.jpg")


class Answers:
    """All answers, one at a time; what is heavy is imported and loaded when it is first needed.

    Files are there while their question is answered, and then they are gone. Messages call them by the names they have
    where they come from.

    >>> found = Answers().answer("photo", [("house.jpg", content)], {})  # doctest: +SKIP
    >>> print(found["verdict"], found["reasons"])  # doctest: +SKIP
    """

    def __init__(self) -> None:
        self._one_at_a_time = Lock()

    @cached_property
    def _calibrator(self) -> "PhotoCalibrator":
        from sextant.applications.calibration.calibrator import PhotoCalibrator

        return PhotoCalibrator.load()

    @cached_property
    def _same_place(self) -> "SamePlace":
        from sextant.applications.demonstration.same_place import SamePlace

        return SamePlace.load()

    @cached_property
    def _digits(self) -> "DigitTrial":
        from sextant.applications.demonstration.digit import DigitTrial

        return DigitTrial.load()

    def prepare(self) -> None:
        """Load what the first questions need, while the user still looks for a photo."""
        for model in ("_calibrator", "_same_place", "_digits"):
            with self._one_at_a_time, suppress(UserError):  # a question may come between; it says what is wrong
                getattr(self, model)

    def answer(self, question: str, files: Sequence[tuple[str, bytes]], settings: Mapping[str, str]) -> dict[str, Any]:
        """The answer to one of :data:`QUESTIONS`.

        Args:
            question: which.
            files: names and contents.
            settings: of the question.

        Raises:
            UserError: files are missing or cannot be used, or a setting is wrong.
        """
        least, most, ask = QUESTIONS[question]
        if not least <= len(files) <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            raise UserError(f"{len(files)} files were sent; {wanted} are needed", "Choose or drop a photo first.")
        with self._one_at_a_time, _in_memory(files) as paths:
            return ask(self, paths, settings)

    def photo(self, paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
        """The camera of a photo."""
        from sextant.applications.demonstration.photo import photo_answer

        return photo_answer(self._calibrator, paths[0])

    def picture(self, paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
        """A photo as the page can show it."""
        from sextant.applications.demonstration.pictures import page_picture

        return page_picture(paths[0])

    def places(self, paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
        """How alike two photos are."""
        return self._same_place.answer(*paths)

    def example(self, paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
        """Where the like of an example is."""
        from sextant.applications.demonstration.where_else import where_else_answer

        points = [_point(word) for word in settings.get("points", "").split(";") if word]
        return where_else_answer(paths, points, turned="turned" in settings, resized="resized" in settings)

    def digit(self, paths: Sequence[Path], settings: Mapping[str, str]) -> dict[str, Any]:
        """What becomes of a digit, the user's own or one that somebody wrote."""
        if paths:
            return self._digits.answer(paths[0])
        try:
            return self._digits.of_scan(int(settings.get("digit", "")))
        except ValueError:
            raise UserError("there is no digit to look at", "Draw one, choose a picture, or choose a sample.") from None


#: question -> how many files it takes, least and most, and who answers
QUESTIONS: dict[str, tuple[int, int, Callable[[Answers, Sequence[Path], Mapping[str, str]], dict[str, Any]]]] = {
    "photo": (1, 1, Answers.photo),
    "picture": (1, 1, Answers.picture),
    "places": (2, 2, Answers.places),
    "example": (1, 2, Answers.example),
    "digit": (0, 1, Answers.digit),
}


def sample_photo(name: str) -> bytes:
    """One of the two photos that come with scikit-learn.

    Raises:
        UserError: there is none of that name.
    """
    if name not in SAMPLES:
        raise UserError(f"{name}: there is no such sample", f"There are: {', '.join(SAMPLES)}")
    return (files_of("sklearn.datasets.images") / name).read_bytes()


@contextmanager
def _in_memory(files: Sequence[tuple[str, bytes]]) -> Iterator[list[Path]]:
    """Files of these contents while the block runs; its mistakes name them as the user does."""
    with tempfile.TemporaryDirectory(prefix="sextant-", dir=MEMORY if MEMORY.is_dir() else None) as folder:
        paths = [Path(folder, f"{number}{_suffix(name)}") for number, (name, _) in enumerate(files)]
        for path, (_, content) in zip(paths, files, strict=True):
            path.write_bytes(content)
        try:
            yield paths
        except UserError as error:
            problem, fix = error.problem, error.fix or ""
            for path, (name, _) in zip(paths, files, strict=True):
                problem, fix = (text.replace(str(path), name or "the picture") for text in (problem, fix))
            raise UserError(problem, fix or None) from None


def _suffix(name: str) -> str:
    suffix = Path(name).suffix
    return suffix if suffix[1:].isascii() and suffix[1:].isalnum() and len(suffix) < 8 else ""


def _point(word: str) -> "Point":
    try:
        number, x, y = word.split(",")
        return int(number), float(x), float(y)
    except ValueError:
        raise UserError(f"points={word} is no point", "Point into one of the photos.") from None
