"""All drives of a dataset: the one that makes the map, and those localized in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sextant.chapters.localization.data.drive import Drive
from sextant.worlds.laser import LaserScanner

ProtocolName = Literal["office", "town", "railway"]


@dataclass(frozen=True, eq=False)
class LocalizationData:
    """Drives with poses in one frame. The frames of each are counted from 0: ``frames`` is ``0, 1, 2, ...``.

    Attributes:
        map: images at known poses.
        test: drives to localize in ``map``.
        validation: drives on which temperatures and noise are fitted; none of their frames is in ``test``.
        validation_map: the map in which ``validation`` is localized; None if that is ``map``.
        unit: of x and y; ``frames`` along a railway, where y and heading are zero.
        protocol: the rules by which success is judged.
        fit_map: images that the descriptor and the kernel are fitted to; None if those are ``map``.
        scanner: the one that made the laser scans, or None.
        other_maps: the route of ``map`` under other conditions. They may be the drives of ``test``.
        corrupted: the drives of ``test`` under image corruptions, which are localized too.
        notes: what a reader of results should know: files left out, missing odometry.
    """

    map: Drive
    test: tuple[Drive, ...]
    validation: tuple[Drive, ...]
    validation_map: Drive | None
    unit: Literal["m", "frames"]
    protocol: ProtocolName
    scanner: LaserScanner | None = None
    fit_map: Drive | None = None
    other_maps: tuple[Drive, ...] = ()
    notes: tuple[str, ...] = ()
    corrupted: tuple[Drive, ...] = ()

    @property
    def fitted(self) -> Drive:
        """The images that the descriptor and the kernel are fitted to."""
        return self.map if self.fit_map is None else self.fit_map

    def __post_init__(self) -> None:
        names = [drive.name for drive in (*self.test, *self.corrupted, *self.validation)]
        if len(set(names)) < len(names):
            raise ValueError(f"drives need distinct names: {names}")


def first_share(drives: Sequence[Drive], share: float) -> tuple[tuple[Drive, ...], tuple[Drive, ...]]:
    """The first ``share`` of each drive for validation, and the rest for the test.

    Each part has at least one frame.

    Raises:
        ValueError: ``share`` is not within (0, 1), or a drive has fewer than two frames.
    """
    if not 0 < share < 1:
        raise ValueError(f"share={share} must be within (0, 1)")
    if any(len(drive) < 2 for drive in drives):
        raise ValueError("a drive to split needs two frames")
    cuts = [min(max(1, round(share * len(drive))), len(drive) - 1) for drive in drives]
    parts = [(drive.select(0, cut), drive.select(cut).renumbered()) for drive, cut in zip(drives, cuts, strict=True)]
    return tuple(replace(early, name=f"{early.name}/start") for early, _ in parts), tuple(late for _, late in parts)
