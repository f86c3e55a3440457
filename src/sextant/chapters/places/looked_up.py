"""What is found where photos are looked up in a map."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.places.describing import DescribedPhotos
from sextant.chapters.places.match_confidence import Verdict, verdict
from sextant.chapters.places.matching import Matches


@dataclass(frozen=True)
class PlaceMatch:
    """A photo of the map, as a match of another photo.

    Attributes:
        photo: its file, which may have been deleted since it was added.
        similarity: cosine of the two descriptors, in [-1, 1]; by sequences, the mean along the best line.
        confidence: probability in [0, 1] that it shows the same place, assuming that the place is in the map; None
            without a temperature, and by sequences.
        position: x and y in metres; None if unknown.
        inliers: local features shared with the photo that agree with one epipolar geometry; None if not re-ranked.
    """

    photo: Path
    similarity: float
    confidence: float | None = None
    position: tuple[float, float] | None = None
    inliers: int | None = None


@dataclass(frozen=True)
class LookedUp:
    """What was found for one photo.

    Attributes:
        name: its file, or the position of its array among those given.
        matches: the best-matching photos of the map, the best first.
        margin: similarity of the best match minus that of the best photo of another place, at least 0; None if the map
            has no other place, if re-ranking replaced the best match, and by sequences.
        found: probability in [0, 1] that the best match shows the photo's place, which need not be in the map; for
            networks, from the margin and, if re-ranked by XFeat, from inliers
            (:mod:`~sextant.chapters.places.match_confidence`). None if unknown.
        stretched: the photo's aspect differs from that of the network's images by a factor above 1.4, so it was
            stretched that much.
    """

    name: str
    matches: tuple[PlaceMatch, ...]
    margin: float | None = None
    found: float | None = None
    stretched: bool = False

    @property
    def best(self) -> PlaceMatch:
        """The best match."""
        return self.matches[0]

    @property
    def verdict(self) -> Verdict | None:
        """Whether the place is in the map: it is not if :attr:`found` is below one half. None if that is unknown."""
        return verdict(self.found)


def looked_up(
    names: Sequence[str],
    stretched: Sequence[bool],
    reference: DescribedPhotos,
    found: Matches,
    found_probability: Float64[ndarray, "m"] | None = None,
) -> list[LookedUp]:
    """What was found for each photo: by sequences if they were matched that way, otherwise individually."""
    folder, files = reference.photos.folder, reference.index.names or ()
    results = []
    for i, name in enumerate(names):
        sequenced = found.by_sequence(i)
        matches = tuple(
            PlaceMatch(
                folder / files[each.image],
                each.similarity,
                each.confidence,
                _position(reference, each.image),
                each.inliers,
            )
            for each in (found.single(i) if sequenced is None else sequenced)
        )
        margin = found.margin_of(i) if sequenced is None else None
        sure = None if found_probability is None or sequenced is not None else float(found_probability[i])
        results.append(LookedUp(name, matches, margin, None if sure is None or sure != sure else sure, stretched[i]))
    return results


def _position(reference: DescribedPhotos, number: int) -> tuple[float, float] | None:
    if reference.positions is None:
        return None
    x, y = reference.positions[number].tolist()
    return None if x != x or y != y else (x, y)
