"""Metrics, protocols and statistics."""

from sextant.evaluation.corruption_baseline import (
    ALEXNET_CIFAR10_C,
    ALEXNET_IMAGENET_C,
    CorruptionBaseline,
    read_baseline,
    write_baseline,
)
from sextant.evaluation.corruption_difference import CorruptionDifferences, corruption_differences
from sextant.evaluation.corruption_error import (
    ALL_19,
    BENCHMARK_15,
    CORRUPTION_FAMILIES,
    CorruptionErrors,
    CorruptionScore,
    corruption_score,
    error_rate,
)
from sextant.evaluation.flip_probability import flip_probability, mean_flip_probability
from sextant.evaluation.multiplicity import holm
from sextant.evaluation.paired import PairedDifference, mean_interval, paired_difference
from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM, classification_converged

__all__ = [
    "ALEXNET_CIFAR10_C",
    "ALEXNET_IMAGENET_C",
    "ALL_19",
    "BENCHMARK_15",
    "CORRUPTION_FAMILIES",
    "SEEDS_FOR_A_CLAIM",
    "CorruptionBaseline",
    "CorruptionDifferences",
    "CorruptionErrors",
    "CorruptionScore",
    "PairedDifference",
    "classification_converged",
    "corruption_differences",
    "corruption_score",
    "error_rate",
    "flip_probability",
    "holm",
    "mean_flip_probability",
    "mean_interval",
    "paired_difference",
    "read_baseline",
    "write_baseline",
]
