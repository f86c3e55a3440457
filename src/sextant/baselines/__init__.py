"""Training-free descriptors of places: what a learned descriptor has to beat.

Each has ``fit(images)`` and ``describe(images)``, takes its parameters in the constructor alone, and goes with cosine
similarity.
"""

from sextant.baselines.descriptor import PlaceDescriptor
from sextant.baselines.grey import grey_images
from sextant.baselines.hog import Hog
from sextant.baselines.patch_normalised import PatchNormalised
from sextant.baselines.pixels import Pixels
from sextant.baselines.whitened_pca import WhitenedPCA

__all__ = ["Hog", "PatchNormalised", "Pixels", "PlaceDescriptor", "WhitenedPCA", "grey_images"]
