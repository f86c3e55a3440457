"""Seeded, batched image corruptions: parameters are drawn, then applied."""

from sextant.corruptions.contrast_poisson import ContrastPoisson
from sextant.corruptions.corruption import Corruption
from sextant.corruptions.gaussian_noise import GaussianNoise
from sextant.corruptions.suite import Condition, CorruptionSuite

__all__ = ["Condition", "ContrastPoisson", "Corruption", "CorruptionSuite", "GaussianNoise"]
