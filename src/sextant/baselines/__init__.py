"""Training-free and linear descriptors of places, the baselines of learned descriptors.

Each has ``fit(images)`` and ``describe(images)``, takes its parameters only in the constructor, and is compared by
cosine similarity. ``LDA`` and ``CCA`` instead learn from pairs of images, by ``fit_pairs(reference, query)``, and
describe images of the query's condition by ``describe_query(images)``, which for all others equals ``describe``.
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
