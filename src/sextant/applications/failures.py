"""Photos among many that could not be used."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeVar, get_args

import cv2

from sextant.applications.arguments import check_several
from sextant.data.photo_files import nothing_usable
from sextant.errors import ArgumentError, UserError
from sextant.tables import counted

#: treatment of photos that fail: an error that names them, or an entry for each among the results
Errors = Literal["raise", "return"]
Photo = TypeVar("Photo")
Result = TypeVar("Result")


@dataclass(frozen=True)
class FailedPhoto:
    """A photo that could not be used.

    Attributes:
        name: its file, or the position of its array.
        error: the reason.
    """

    name: str
    error: UserError

    def row(self) -> dict[str, Any]:
        """Plain values."""
        return {"file": self.name, "error": self.error.problem}


class FailedPhotosError(UserError):
    """Several photos could not be used; each is named with the reason.

    Attributes:
        failed: the photos that could not be used.
    """

    failed: tuple[FailedPhoto, ...] = ()

    def __reduce__(self) -> Any:
        return *super().__reduce__(), {"failed": self.failed}

    @classmethod
    def of(cls, failed: Sequence[FailedPhoto], count: int, done: str, rest: str) -> Self:
        """The error for some or all of ``count`` photos.

        Args:
            failed: the photos that could not be used.
            count: number of all photos.
            done: participle of the failed action, such as ``calibrated``.
            rest: advice for getting the results of the others, if there are any.
        """
        none = len(failed) == count
        problem = f"none of {counted(count, 'photo')} could be {done}"
        told = nothing_usable(
            problem if none else f"{len(failed):,} of {counted(count, 'photo')} could not be {done}",
            {each.name: each.error.problem for each in failed},
            None if none else f"Replace these files, or {rest}",
        )
        error = cls(told.problem, told.fix)
        error.failed = tuple(failed)
        return error


def attempted(name: str, work: Callable[..., Result], *given: Any) -> Result | FailedPhoto:
    """Apply ``work`` to a photo; if it fails, return the reason, so that other photos are still processed.

    Args:
        name: name of the photo.
        work: function that processes this photo only.
        given: arguments of ``work``.
    """
    try:
        return work(*given)
    except UserError as error:
        return FailedPhoto(name, error)
    except (ArithmeticError, ValueError, cv2.error) as error:  # NumPy and SciPy raise ValueError too
        problem = f"{name} could not be calibrated ({type(error).__name__}: {error})"
        return FailedPhoto(name, UserError(problem, "Leave it out, and report this with the photo."))


def several(photos: Iterable[Photo], errors: Errors, argument: str = "photos") -> Iterable[Photo]:
    """Check that several photos are given, and return them as they are.

    Args:
        photos: files or arrays.
        errors: checked as well.
        argument: name of the caller's argument.

    Raises:
        ArgumentError: ``photos`` is not a collection, or ``errors`` is not one of :data:`Errors`.
    """
    check_errors(errors)
    check_several(argument, photos)
    return photos


def check_errors(errors: Errors) -> None:
    """Raise an ``ArgumentError`` if ``errors`` is not one of :data:`Errors`."""
    if errors not in get_args(Errors):
        raise ArgumentError(f"errors={errors} must be one of {', '.join(get_args(Errors))}")


def raise_failed(
    found: Iterable[object],
    count: int,
    done: str,
    errors: Errors,
    rest: str = 'give errors="return" for the others.',
) -> None:
    """Raise an error that names all photos that failed, unless ``errors`` is ``return``.

    Args:
        found: results, with a :class:`FailedPhoto` for each photo that failed.
        count, done, rest: as for :meth:`FailedPhotosError.of`.
        errors: the user's choice.

    Raises:
        FailedPhotosError: a photo failed.
    """
    failed = [each for each in found if isinstance(each, FailedPhoto)]
    if failed and errors == "raise":
        raise FailedPhotosError.of(failed, count, done, rest)
