"""A suggested task and its commands."""

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


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


def outputs(base: str, folder: Path, inputs: Iterable[Path]) -> dict[Path, Path]:
    """A folder of its own, below ``base``, for the results of each file or folder of a folder.

    Files lose their suffix, unless two would then have one name, or one that of a folder. A dot in a folder's name does
    not begin a suffix.

    >>> outputs("walk", Path(), [Path("a/1.mp4"), Path("b/1.mp4")])[Path("b/1.mp4")].as_posix()
    'walk/b/1'
    >>> outputs("walk", Path(), [Path("1.mp4"), Path("1.bag")])[Path("1.bag")].as_posix()
    'walk/1.bag'
    """
    whole = dict.fromkeys(inputs)
    short = {each: each if (folder / each).is_dir() else each.with_suffix("") for each in whole}
    of_folders = any(each != name and (folder / name).is_dir() for each, name in short.items())
    apart = len(set(short.values())) == len(short) and not of_folders
    return {each: Path(base, short[each] if apart else each) for each in whole}
