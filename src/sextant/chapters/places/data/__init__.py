"""Images of places under changing conditions: their sources, which show the same place, and batches for training.

Parts that need torch (batches, augmentation) are imported from their own modules; sources do not need it.
"""

from sextant.chapters.places.data.image_rows import ImageRows
from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.nordland import Nordland
from sextant.chapters.places.data.place_folders import PlaceFolders
from sextant.chapters.places.data.scenes import Scenes
from sextant.chapters.places.data.source import PlaceSource, as_place_source, rendered_place_source
from sextant.chapters.places.data.splits import ConditionSplit, ConditionSplitSource, FrameRanges
from sextant.chapters.places.data.tolerance import PlaceTolerance

__all__ = [
    "ConditionSplit",
    "ConditionSplitSource",
    "FrameRanges",
    "ImageRows",
    "Nordland",
    "PlaceFolders",
    "PlaceImages",
    "PlaceSource",
    "PlaceTolerance",
    "Scenes",
    "as_place_source",
    "rendered_place_source",
]
