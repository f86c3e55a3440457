"""Images of places under changing conditions: their sources, which show the same place, and batches for training.

What needs torch (batches, augmentation) is imported from its own module; sources do not need it.
"""

from sextant.data.places.image_rows import ImageRows
from sextant.data.places.images import PlaceImages
from sextant.data.places.nordland import Nordland
from sextant.data.places.place_folders import PlaceFolders
from sextant.data.places.scenes import Scenes
from sextant.data.places.source import PlaceSource, as_place_source, rendered_place_source
from sextant.data.places.splits import ConditionSplit, ConditionSplitSource, FrameRanges
from sextant.data.places.tolerance import PlaceTolerance

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
