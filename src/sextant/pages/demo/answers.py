"""Answers for the page: uploaded files and settings in, plain values out."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib.resources import files as files_of
from pathlib import Path
from threading import Lock
from typing import Any

from sextant.errors import UserError

#: a folder in memory, so that dropped files never reach a disk; where it is missing or full, the default folder for
#: temporary files is used instead
MEMORY = Path("/dev/shm")
SAMPLES = ("china.jpg", "flower.jpg")
_one_at_a_time = Lock()


def prepare() -> None:
    """Load what the first questions need, while the user still looks for a photo."""
    from sextant.pages.demo import questions

    for load in (questions.calibrator, questions.same_place, questions.digit_trial):
        with _one_at_a_time, suppress(UserError):  # a question may come between; it reports what is wrong
            load()


def answer(question: str, files: Sequence[tuple[str, bytes]], settings: Mapping[str, str]) -> dict[str, Any]:
    """Answer one of :data:`~sextant.pages.demo.questions.QUESTIONS`; questions are answered one at a time.

    Files exist only while their question is answered. Messages call them by the names under which they were uploaded.

    >>> found = answer("photo", [("house.jpg", content)], {})  # doctest: +SKIP
    >>> print(found["verdict"], found["reasons"])  # doctest: +SKIP

    Args:
        question: name of the question.
        files: names and contents.
        settings: settings of the question.

    Raises:
        UserError: there is no such question, files are missing or cannot be used, or a setting is wrong.
    """
    from sextant.pages.demo.questions import QUESTIONS

    if question not in QUESTIONS:
        raise UserError(f"{question}: no such question", f"There are: {', '.join(QUESTIONS)}")
    least, most, ask = QUESTIONS[question]
    if not least <= len(files) <= most:
        wanted = f"{least}" if least == most else f"{least} to {most}"
        raise UserError(f"{len(files)} files were sent; {wanted} are needed", "Choose or drop a photo first.")
    with _one_at_a_time, _stored(files) as paths:
        return ask(paths, settings)


def sample_photo(name: str) -> bytes:
    """One of the two photos that come with scikit-learn.

    Raises:
        UserError: there is none of that name.
    """
    if name not in SAMPLES:
        raise UserError(f"{name}: there is no such sample", f"There are: {', '.join(SAMPLES)}")
    return (files_of("sklearn.datasets.images") / name).read_bytes()


@contextmanager
def _stored(files: Sequence[tuple[str, bytes]]) -> Iterator[list[Path]]:
    """Store files with these contents while the block runs; errors in the block name them as the user does."""
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
