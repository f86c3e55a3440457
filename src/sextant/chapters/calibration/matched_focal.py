r"""The focal length that photos of one camera share, from their matches: evidence beside lines and network.

Groups of consecutive photos are matched, each by itself (:func:`~sextant.correspondence.shared_focal_length`). The
focal length is used only if at least two groups give the same: in photos of a street one group alone is 33 % off with
a standard deviation of a few (``python -m benchmarks.one_camera``). Groups that disagree show that the camera zoomed
between them, or that a scene misleads.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.chapters.calibration.metrics.fusion import fuse
from sextant.errors import UserError
from sextant.tables import counted

if TYPE_CHECKING:  # it imports SciPy's statistics, which two photos do not need
    from sextant.correspondence import LocalFeatureExtractor, LocalFeatures, SharedFocalLength

#: photos of a group: three check each other, and five determine a focal length to 1 % in 5 CPU seconds
#: (``python -m benchmarks.shared_focal``)
LEAST, MOST = 3, 5
#: groups that confirm each other, and the most that are matched
CONFIRMED, GROUPS = 2, 3
#: beginning of the reason why there is no answer; the reasons by the verdict of a group
UNUSED, FEW = "matches between the photos were not used", "it takes six different photos"
WHY = {
    "no common scene": "too few agree",
    "undetermined": "they agree with many focal lengths",
    "moving scene": "something in the scene moves",
    "unchecked": "only two photos of a group show one scene",
}
#: numbers of features, and the longer side of the pictures that they are found in, of that benchmark
KEYPOINTS, SIDE = 4096, 1024
#: number of strongest features by which a photo is compared with the one before, and the share of these that another
#: within a pixel makes a view from the same place: noise would pass for motion in such photos
COMPARED, STILL = 1000, 0.3


@dataclass(frozen=True)
class MatchedFocal:
    """What the matches of photos of one camera say about its focal length.

    Attributes:
        summary: in words: the focal length, or why there is none.
        focal: focal length over the longer side of a photo; nan if unknown.
        sigma: its relative standard deviation; infinite if unknown.
        zoomed: the photos of a group have another focal length than those of another, or a scene misleads.
        photos: the number of photos that were matched.
    """

    summary: str
    focal: float = math.nan
    sigma: float = math.inf
    zoomed: bool = False
    photos: int = 0


def groups(count: int) -> list[range]:
    """Numbers of the photos of each group: two or three of three to five consecutive ones, spread over all.

    >>> groups(5), groups(7), groups(100)
    ([], [range(0, 3), range(4, 7)], [range(0, 5), range(47, 52), range(95, 100)])
    """
    if count < CONFIRMED * LEAST:
        return []
    number = min(GROUPS, max(CONFIRMED, count // MOST))
    size = min(MOST, count // number)
    starts = np.linspace(0, count - size, number).astype(int).tolist()
    return [range(start, start + size) for start in starts]


class PhotoMatches:
    """Finds the local features of photos of one camera while these are read, then their focal length.

    Args:
        count: number of the photos; None if it is not known.
        extractor: local features; XFeat by default.

    Attributes:
        features: local features by the names of the photos.
    """

    def __init__(self, count: int | None, extractor: "LocalFeatureExtractor | None" = None):
        self._groups = groups(GROUPS * MOST if count is None else count)
        self.features: dict[str, LocalFeatures] = {}
        self._seen = 0
        self._missing = "" if self._groups else FEW
        if self._groups:
            from sextant.correspondence import XFeatures

            self._extractor = extractor or XFeatures(KEYPOINTS, SIDE)
            try:
                getattr(self._extractor, "check", lambda: None)()
            except UserError as error:
                self._missing = f"{error.problem}: {error.fix}"

    def see(self, name: str, image: UInt8[ndarray, "h w 3"]) -> None:
        """Find the features of a photo if it belongs to a group."""
        if not self._missing and any(self._seen in group for group in self._groups):
            from sextant.correspondence import detected

            self.features[name] = detected(self._extractor, np.ascontiguousarray(image))
        self._seen += 1

    def focal(self, names: Sequence[str]) -> MatchedFocal:
        """What the matches of these photos say, in their order."""
        if self._missing:
            return MatchedFocal(f"{UNUSED}: {self._missing}")
        seen = list[str]()
        for name in names:
            if name in self.features and not (seen and still(self.features[seen[-1]], self.features[name])):
                seen.append(name)
        if len(seen) < CONFIRMED * LEAST:
            return MatchedFocal(f"{UNUSED}: {FEW}")
        from sextant.correspondence import shared_focal_length

        sides = {name: max(self.features[name].width, self.features[name].height) for name in seen}
        found, reasons = dict[tuple[str, ...], "SharedFocalLength"](), list[str]()
        for group in groups(len(seen)):
            own = tuple(seen[number] for number in group)
            try:
                answer = shared_focal_length([self.features[name] for name in own])
            except UserError as error:  # photos of several sizes
                reasons.append(error.problem)
                continue
            if answer.verdict == "known":
                found[own] = replace(answer, focal_px=answer.focal_px * sides[seen[0]] / sides[own[0]])
            else:
                reasons.append(WHY[answer.verdict])
        if len(found) < CONFIRMED:
            alone = ["only one group of photos determines it, and none confirms it"] * len(found)
            return MatchedFocal(f"{UNUSED}: {'; '.join(dict.fromkeys([*alone, *reasons]))}")
        return combined(found, sides[seen[0]])


def still(one: "LocalFeatures", other: "LocalFeatures") -> bool:
    """Whether the camera did not move between two photos: many of their strongest features are at the same place.

    >>> from sextant.correspondence import LocalFeatures
    >>> points = np.random.default_rng(0).uniform(0, 500, (200, 2)).astype(np.float32)
    >>> noise, descriptors = np.float32(0.1), np.ones((200, 1), np.float16)
    >>> photos = [LocalFeatures(points + off, descriptors, 500, 500) for off in (0, noise, 40 * noise)]
    >>> still(photos[0], photos[1]), still(photos[0], photos[2])
    (True, False)
    """
    from scipy.spatial import cKDTree

    if not (len(one) and len(other)):
        return False
    apart, _ = cKDTree(one.points[:COMPARED]).query(other.points[:COMPARED])
    return bool(np.mean(apart < max(one.pixel, other.pixel)) >= STILL)


def combined(found: "Mapping[tuple[str, ...], SharedFocalLength]", side: int) -> MatchedFocal:
    """The focal length by groups of photos whose longer side has ``side`` pixels; none if they disagree.

    >>> from sextant.correspondence import SharedFocalLength
    >>> one = SharedFocalLength("known", 1000.0, 0.01, photos=[0, 1, 2])
    >>> other = SharedFocalLength("known", 1400.0, 0.01, photos=[0, 1, 2])
    >>> combined({("a", "b", "c"): one, ("d", "e", "f"): other}, 1000).summary
    'the camera zoomed, or a scene misleads: matches give 1000 ± 10 px in a to c, 1400 ± 14 px in d to f'
    """
    from sextant.correspondence.shared_focal import MODEL

    logs, sigmas = [], []
    for each in found.values():
        assert each.focal_sigma is not None
        logs.append([math.log(each.focal_px / side)])
        sigmas.append([each.focal_sigma])
    common = float(np.mean(np.square(MODEL / np.array(sigmas)).clip(max=1)))  # of the lens, in all groups
    fused = fuse(np.array(logs), np.array(sigmas), correlation=common)
    photos = sum(len(each.photos) for each in found.values())
    if not fused.consistent or not fused.kept.all():
        each_group = ", ".join(
            f"{each.focal_px:.0f} ± {each.focal_px * sigma:.0f} px in {Path(names[0]).name} to {Path(names[-1]).name}"
            for (names, each), (sigma,) in zip(found.items(), sigmas, strict=True)
        )
        return MatchedFocal(
            f"the camera zoomed, or a scene misleads: matches give {each_group}", zoomed=True, photos=photos
        )
    focal, sigma = math.exp(fused.values[0]), float(fused.sigmas[0])
    summary = f"{counted(photos, 'photo')} match: focal length {focal * side:.0f} ± {focal * side * sigma:.0f} px"
    return MatchedFocal(summary, focal, sigma, photos=photos)
