"""The photos of a map or of queries; imports no torch."""

from dataclasses import dataclass
from pathlib import Path

#: what a folder of descriptors has; see :mod:`~sextant.applications.places.saved_map`
HEADER = "map.json"


@dataclass(frozen=True)
class PhotoFolder:
    """Photos of a folder.

    Attributes:
        folder: that the names are relative to.
        names: of the files in natural order: ``image2`` before ``image10``.
    """

    folder: Path
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return [self.folder / name for name in self.names]
