"""The public names of the package."""

from sextant.evaluation.corruption_difference import CorruptionDifferences, corruption_differences
from sextant.evaluation.corruption_errors import (
    ALEXNET_CIFAR10_C,
    ALEXNET_IMAGENET_C,
    ALL_19,
    BENCHMARK_15,
    CORRUPTION_FAMILIES,
    CorruptionBaseline,
    CorruptionErrors,
    CorruptionScore,
    corruption_score,
)
from sextant.evaluation.flips import flip_probability, mean_flip_probability
from sextant.evaluation.paired import PairedDifference, holm, mean_interval, paired_difference
from sextant.evaluation.particle_counts import CountRatio, needed_ratio, particles_needed
from sextant.evaluation.pose_posterior import (
    PosteriorCalibration,
    nees,
    particle_nll,
    posterior_calibration,
)
from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM, LocalizationProtocol, classification_converged
from sextant.evaluation.shares import share_interval, share_interval_of
from sextant.evaluation.stratified import Sample, StratifiedDifference, stratified_difference
from sextant.evaluation.success import ConvergenceSummary, global_localization, recovery_after
from sextant.evaluation.trajectory_error import ErrorStatistics, absolute_errors, relative_errors

__all__ = [
    "ALEXNET_CIFAR10_C",
    "ALEXNET_IMAGENET_C",
    "ALL_19",
    "BENCHMARK_15",
    "CORRUPTION_FAMILIES",
    "SEEDS_FOR_A_CLAIM",
    "ConvergenceSummary",
    "CorruptionBaseline",
    "CorruptionDifferences",
    "CorruptionErrors",
    "CorruptionScore",
    "CountRatio",
    "ErrorStatistics",
    "LocalizationProtocol",
    "PairedDifference",
    "PosteriorCalibration",
    "Sample",
    "StratifiedDifference",
    "absolute_errors",
    "classification_converged",
    "corruption_differences",
    "corruption_score",
    "flip_probability",
    "global_localization",
    "holm",
    "mean_flip_probability",
    "mean_interval",
    "needed_ratio",
    "nees",
    "paired_difference",
    "particle_nll",
    "particles_needed",
    "posterior_calibration",
    "recovery_after",
    "relative_errors",
    "share_interval",
    "share_interval_of",
    "stratified_difference",
]
