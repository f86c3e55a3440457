"""A suggested task and its commands."""

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Suggestion:
    """A task that fits the contents of a folder.

    Attributes:
        task: what it does.
        why: what in the folder suggests it, and what the user has to take care of.
        commands: commands to copy; ``<map>`` stands for one of the user's maps.
    """

    task: str
    why: str
    commands: tuple[str, ...]


def command(verb: str, *words: str, **values: object) -> str:
    """``sextant <verb> ... key=value ...``, each word quoted for a shell; ``map=<map>``, to be filled in, is not."""
    quoted = [shlex.quote(word) for word in (*words, *(f"{key}={value}" for key, value in values.items()))]
    return " ".join(["sextant", verb, *quoted]).replace("'map=<map>'", "map=<map>")


def override(path: Path | str) -> str:
    """A path as a value in Hydra's grammar: quoted unless it consists of plain characters."""
    text = str(path)
    if re.fullmatch(r"[\w./+-]+", text, re.ASCII):
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def overrides_of(folders: Mapping[str, Path]) -> str:
    """Named folders as a mapping in Hydra's grammar: ``{run: run}``."""
    return "{" + ", ".join(f"{name}: {override(folder)}" for name, folder in folders.items()) + "}"


def plain_name(text: str) -> str:
    """A name that can be a key of a config."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    return name if name and not name[0].isdigit() else f"run_{name}"
