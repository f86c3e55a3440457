"""Translates the words of a command line that describe a search into overrides for Hydra."""

import re
from collections.abc import Sequence

RANGE = re.compile(r"(?P<key>[^=\s]+)=(?P<range>(?:log_uniform|uniform|int)\s*\(.*\))")
METHOD = "sweep.search="


def is_range(text: str) -> bool:
    """Whether an override gives a range of numbers; Hydra reads ``int(2.5)`` as a number, not a range."""
    found = RANGE.fullmatch(text)
    return found is not None and (found["range"].startswith(("log", "uni")) or "," in text)


def search_words(words: Sequence[str]) -> list[str]:
    """Rewrite the overrides of a search so that Hydra can compose them.

    ``sweep.search=tpe`` names the method. It needs no stored sweep, so keys of ``sweep`` are added. A range becomes
    text. An override that lists several values is a choice, as in other sweeps.
    """
    searching = any(word.startswith(("sweep.search", "++sweep.search")) for word in words)
    return [_composable(word, searching) for word in words]


def _composable(word: str, searching: bool) -> str:
    if is_range(word):
        key, _, text = word.partition("=")
        return f'{key}="{text}"'
    if word.startswith(METHOD):
        return f"++{METHOD[:-1]}.method={word.removeprefix(METHOD)}"
    return f"++{word}" if searching and word.startswith("sweep.") else word
