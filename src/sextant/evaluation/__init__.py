"""Metrics, protocols and statistics."""

from sextant.evaluation.multiplicity import holm
from sextant.evaluation.paired import PairedDifference, mean_interval, paired_difference
from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM, classification_converged

__all__ = [
    "SEEDS_FOR_A_CLAIM",
    "PairedDifference",
    "classification_converged",
    "holm",
    "mean_interval",
    "paired_difference",
]
