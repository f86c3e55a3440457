"""A suggested task and its commands."""

import shlex
from dataclasses import dataclass


@dataclass(frozen=True)
class Suggestion:
    """A task that fits the contents of a folder.

    Attributes:
        task: what it does.
        why: what in the folder suggests it, and what the user must ensure.
        commands: commands to copy; ``<map>`` stands for one of the user's maps.
    """

    task: str
    why: str
    commands: tuple[str, ...]


def command(verb: str, *words: str, **values: object) -> str:
    """``sextant <verb> ... key=value ...``, each word quoted for a shell; ``map=<map>``, to be filled in, is not."""
    quoted = [shlex.quote(word) for word in (*words, *(f"{key}={value}" for key, value in values.items()))]
    return " ".join(["sextant", verb, *quoted]).replace("'map=<map>'", "map=<map>")
