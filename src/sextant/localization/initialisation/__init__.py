"""Initialisation: the belief a filter starts from."""

from sextant.localization.initialisation.appearance import AppearanceStart
from sextant.localization.initialisation.gaussian import GaussianStart
from sextant.localization.initialisation.initialisation import Initialisation
from sextant.localization.initialisation.uniform import UniformStart

__all__ = ["AppearanceStart", "GaussianStart", "Initialisation", "UniformStart"]
