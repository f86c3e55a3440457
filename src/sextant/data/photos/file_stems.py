"""Names for the output files of each photo."""

from collections.abc import Sequence
from pathlib import Path


def file_stems(paths: Sequence[Path]) -> list[str]:
    """A name for each photo's files: its own without suffix; with suffix, folder or a number if that is taken."""
    taken: set[str] = set()
    stems = []
    for path in paths:
        wished = [path.stem, f"{path.stem}_{path.suffix[1:]}", f"{path.parent.name}_{path.stem}"]
        numbered = (f"{path.stem}_{i}" for i in range(2, len(paths) + 2))
        stem = next(name for name in (*wished, *numbered) if name.lower() not in taken)
        taken.add(stem.lower())  # file systems may be case-insensitive
        stems.append(stem)
    return stems
