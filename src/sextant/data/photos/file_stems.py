"""Names for the output files of each photo."""

import os
from collections.abc import Sequence
from pathlib import Path

#: bytes of a stem, which leave room for what is added to it: a file's name has at most 255
LONGEST = 200


def file_stems(paths: Sequence[Path]) -> list[str]:
    """A name for each photo's files: its own without suffix; with suffix, folder or a number if that is taken."""
    taken: set[str] = set()
    stems = []
    for path in paths:
        own, folder = (os.fsencode(name)[:LONGEST].decode(errors="ignore") for name in (path.stem, path.parent.name))
        wished = [own, f"{own}_{path.suffix[1:]}"[:LONGEST], f"{folder}_{own}"[:LONGEST]]
        numbered = (f"{own}_{i}" for i in range(2, len(paths) + 2))
        stem = next(name for name in (*wished, *numbered) if name.lower() not in taken)
        taken.add(stem.lower())  # file systems may be case-insensitive
        stems.append(stem)
    return stems
