"""Seeded, batched image corruptions: parameters are drawn, then applied."""

from sextant.corruptions.benchmark_corruption import SEVERITIES, BenchmarkCorruption, Mode
from sextant.corruptions.benchmark_suite import BenchmarkSuite, benchmark_set, cifar10_c, imagenet_c, mnist_c
from sextant.corruptions.corrupt import corrupt
from sextant.corruptions.corruption import Corruption
from sextant.corruptions.noise import ContrastPoisson, GaussianNoise
from sextant.corruptions.perturbation_suite import PerturbationSuite
from sextant.corruptions.pixels import eight_bit, to_bytes
from sextant.corruptions.stored_suite import StoredSuite
from sextant.corruptions.suite import Condition, CorruptionSuite, Protocol

__all__ = [
    "SEVERITIES",
    "BenchmarkCorruption",
    "BenchmarkSuite",
    "Condition",
    "ContrastPoisson",
    "Corruption",
    "CorruptionSuite",
    "GaussianNoise",
    "Mode",
    "PerturbationSuite",
    "Protocol",
    "StoredSuite",
    "benchmark_set",
    "cifar10_c",
    "corrupt",
    "eight_bit",
    "imagenet_c",
    "mnist_c",
    "to_bytes",
]
