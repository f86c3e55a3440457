"""Training-free and linear descriptors of places: what a learned descriptor has to beat.

Each has ``fit(images)`` and ``describe(images)``, takes its parameters in the constructor alone, and is compared by
cosine similarity. ``LDA`` and ``CCA`` instead learn from pairs of images, by ``fit_pairs(reference, query)``, and
describe images of the query's condition by ``describe_query(images)``, which for all others is ``describe``.
"""

from sextant.baselines.cca import CCA
from sextant.baselines.descriptor import PlaceDescriptor
from sextant.baselines.grey import grey_images
from sextant.baselines.hog import Hog
from sextant.baselines.lda import LDA
from sextant.baselines.paired_descriptor import PairedDescriptor
from sextant.baselines.patch_normalised import PatchNormalised
from sextant.baselines.pixels import Pixels
from sextant.baselines.whitened_pca import WhitenedPCA

__all__ = [
    "CCA",
    "LDA",
    "Hog",
    "PairedDescriptor",
    "PatchNormalised",
    "Pixels",
    "PlaceDescriptor",
    "WhitenedPCA",
    "grey_images",
]
