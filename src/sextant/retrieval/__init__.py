"""Relations of images by place, mining of training triplets, and search for the nearest descriptors."""

from sextant.retrieval.cached_mining import CachedHardMining
from sextant.retrieval.flat_index import FlatIndex
from sextant.retrieval.nearest import Neighbours, joined_neighbours, nearest_neighbours
from sextant.retrieval.relations import Places, Relation, Tolerance, relations
from sextant.retrieval.sequence_matching import SequenceMatches, local_contrast, match_sequences, sequence_scores
from sextant.retrieval.triplet_mining import (
    BatchHardMining,
    Mined,
    Mining,
    NoMining,
    RandomMining,
    SemiHardMining,
    all_triplets,
    gathered,
)

__all__ = [
    "BatchHardMining",
    "CachedHardMining",
    "FlatIndex",
    "Mined",
    "Mining",
    "Neighbours",
    "NoMining",
    "Places",
    "RandomMining",
    "Relation",
    "SemiHardMining",
    "SequenceMatches",
    "Tolerance",
    "all_triplets",
    "gathered",
    "joined_neighbours",
    "local_contrast",
    "match_sequences",
    "nearest_neighbours",
    "relations",
    "sequence_scores",
]
