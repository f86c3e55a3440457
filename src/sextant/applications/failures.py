"""Photos that could not be used, among many."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from sextant.data.unusable_files import nothing_usable
from sextant.errors import UserError


@dataclass(frozen=True)
class FailedPhoto:
    """A photo that could not be used.

    Attributes:
        name: its file, or the place of its array.
        error: why.
    """

    name: str
    error: UserError

    def row(self) -> dict[str, Any]:
        """Plain values."""
        return {"file": self.name, "error": self.error.problem}


class FailedPhotosError(UserError):
    """Photos that could not be used, each named with the reason.

    Attributes:
        failed: the photos.
    """

    failed: tuple[FailedPhoto, ...] = ()

    @classmethod
    def of(cls, failed: Sequence[FailedPhoto], count: int, done: str, rest: str) -> Self:
        """The error for some or all of ``count`` photos.

        Args:
            failed: the photos.
            count: of all photos.
            done: what they could not be, such as ``calibrated``.
            rest: what to do about the others, if there are some.
        """
        none = len(failed) == count
        problem = f"none of {count:,} photos could be {done}"
        told = nothing_usable(
            problem if none else f"{len(failed):,} of {count:,} photos could not be {done}",
            {each.name: each.error.problem for each in failed},
            None if none else f"Replace these files, or {rest}",
        )
        error = cls(told.problem, told.fix)
        error.failed = tuple(failed)
        return error
