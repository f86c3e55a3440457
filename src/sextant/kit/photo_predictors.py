"""Predictions of trained models for photos as table rows, for callers over a network."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sextant.errors import UserError

Kind = Literal["string", "double", "doubles"]
Row = dict[str, Any]
#: column of every table: why a photo has no answer; empty if it has one
ERROR = "error"


@dataclass(frozen=True)
class PhotoPredictor:
    """A trained model that predicts from single photos.

    Attributes:
        columns: columns of the prediction and their types: strings, numbers or lists of numbers.
        answer: returns rows for photos of any kind and size, in order; columns without an answer are left out.
    """

    columns: Mapping[str, Kind]
    answer: Callable[[Sequence[Path]], list[Row]]

    def predict(self, photos: Sequence[Path]) -> list[Row]:
        """A row with all columns for each photo, None where there is no answer, and the column ``error``."""
        missing: Row = dict.fromkeys(self.columns)
        return [{**missing, ERROR: "", **row} for row in self.answer(photos)]


def failed_row(error: UserError) -> Row:
    """The row of a photo that cannot be answered."""
    return {ERROR: error.problem}
