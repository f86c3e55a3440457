"""Photos that could not be calibrated."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from sextant.data.unusable_files import nothing_usable
from sextant.errors import UserError


@dataclass(frozen=True)
class FailedPhoto:
    """A photo that could not be calibrated.

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
    """Photos that could not be calibrated, each named with the reason.

    Attributes:
        failed: the photos.
    """

    failed: tuple[FailedPhoto, ...] = ()

    @classmethod
    def of(cls, failed: Sequence[FailedPhoto], count: int) -> Self:
        """The error for some or all of ``count`` photos."""
        if len(failed) == count:
            problem, fix = f"none of {count:,} photos could be calibrated", None
        else:
            problem = f"{len(failed):,} of {count:,} photos could not be calibrated"
            fix = 'Replace these files, or give errors="return" for the cameras of the others.'
        told = nothing_usable(problem, {each.name: each.error.problem for each in failed}, fix)
        error = cls(told.problem, told.fix)
        error.failed = tuple(failed)
        return error
