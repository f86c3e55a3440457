"""Resampling: which particles the next ones descend from, and unbiased thinning."""

from sextant.localization.resampling.multinomial import MultinomialResampling
from sextant.localization.resampling.resampling import Resampling
from sextant.localization.resampling.residual import ResidualResampling
from sextant.localization.resampling.stratified import StratifiedResampling
from sextant.localization.resampling.systematic import SystematicResampling
from sextant.localization.resampling.thinning import thin

__all__ = [
    "MultinomialResampling",
    "Resampling",
    "ResidualResampling",
    "StratifiedResampling",
    "SystematicResampling",
    "thin",
]
