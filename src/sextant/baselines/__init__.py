"""Training-free and linear descriptors of places: what a learned descriptor has to beat.

Each has ``fit(images)`` and ``describe(images)``, takes its parameters in the constructor alone, and is compared by
cosine similarity. ``LDA`` and ``CCA`` instead learn from pairs of images, by ``fit_pairs(reference, query)``, and
describe images of the query's condition by ``describe_query(images)``, which for all others is ``describe``.
"""

from sextant.baselines.learned_projections import CCA, LDA, PairedDescriptor, WhitenedPCA
from sextant.baselines.place_descriptors import Hog, PatchNormalised, Pixels, PlaceDescriptor, grey_images

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
