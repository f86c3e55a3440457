"""Ranges of values that a search may give to a key, written as ``log_uniform(1e-4, 1e-1)``."""

import math
import re
from dataclasses import dataclass
from typing import Literal, get_args

Kind = Literal["uniform", "log_uniform", "int", "choice"]
WRITTEN = re.compile(r"\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.DOTALL)
GRAMMAR = "uniform(low, high), log_uniform(low, high), int(low, high) or choice(a, b, ...)"
#: significant digits of a tried number, so that it can be typed in an override
DIGITS = 6


@dataclass(frozen=True)
class Dimension:
    """The range of one key.

    Attributes:
        kind: ``int`` includes both bounds; ``log_uniform`` is uniform in the logarithm.
        low, high: bounds of a number; nan for a choice.
        options: options of a choice, as written in an override.
    """

    kind: Kind
    low: float = math.nan
    high: float = math.nan
    options: tuple[str, ...] = ()

    @property
    def size(self) -> float:
        """The number of values; infinite for numbers that need not be whole."""
        return len(self.options) or (self.high - self.low + 1 if self.kind == "int" else math.inf)

    @property
    def middle(self) -> str:
        """A value in the middle of the range, as text."""
        if self.kind == "choice":
            return self.options[0]
        both = (math.log(self.low), math.log(self.high)) if self.kind == "log_uniform" else (self.low, self.high)
        mean = sum(both) / 2
        return self.text(math.exp(mean) if self.kind == "log_uniform" else mean)

    @property
    def ends(self) -> tuple[str, ...]:
        """The values that reveal a mistake in the range: both bounds, or every option."""
        return self.options or (self.text(self.low), self.text(self.high))

    def text(self, value: object) -> str:
        """A value as written in an override, with numbers to six significant digits."""
        if self.kind == "choice":
            return str(value)
        number = float(str(value))
        return str(round(number)) if self.kind == "int" else repr(float(f"{number:.{DIGITS}g}"))


def is_dimension(value: object) -> bool:
    """Whether a value of an override is meant as a range, valid or not."""
    found = WRITTEN.fullmatch(value) if isinstance(value, str) else None
    return found is not None and found[1] in get_args(Kind)


def dimension(text: str) -> Dimension:
    """Parse the range of one key.

    Raises:
        ValueError: the text does not follow the grammar, has no bounds, or its bounds are not a range; the message says
            which.
    """
    found = WRITTEN.fullmatch(text)
    if found is None or found[1] not in get_args(Kind):
        raise ValueError(f"{text!r} is no range of values; write {GRAMMAR}")
    kind: Kind = found[1]  # type: ignore[assignment]
    words = _split(found[2])
    if kind == "choice":
        if not words or not all(words) or len(set(words)) < len(words):
            raise ValueError(f"{text}: a choice is between different values, such as choice(adam, sgd)")
        return Dimension(kind, options=tuple(words))
    example = "int(1, 8)" if kind == "int" else f"{kind}(1e-4, 1e-1)"
    if len(words) != 2:
        raise ValueError(f"{text}: {kind} needs two bounds, such as {example}")
    try:
        low, high = (int(word) if kind == "int" else float(word) for word in words)
    except ValueError:
        kind_of = "whole numbers" if kind == "int" else "numbers"
        raise ValueError(f"{text}: the bounds of {kind} are {kind_of}, such as {example}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"{text}: the bounds must be finite, the lower one first")
    if kind == "log_uniform" and low <= 0:
        raise ValueError(f"{text}: a logarithm needs bounds above 0")
    return Dimension(kind, low, high)


def _split(text: str) -> list[str]:
    """Split at commas that are not within brackets or quotes."""
    words, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        depth += (letter in "([{") - (letter in ")]}") if not quote else 0
        if letter == "," and not depth and not quote:
            words.append("")
        else:
            words[-1] += letter
    return [word.strip() for word in words] if text.strip() else []
