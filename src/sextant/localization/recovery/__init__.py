"""Recovery: particles placed elsewhere, for a robot that is not where the filter believes it to be."""

from sextant.localization.recovery.augmented import AugmentedMCL
from sextant.localization.recovery.bayes_restart import BayesRestart
from sextant.localization.recovery.none import NoRecovery
from sextant.localization.recovery.recovery import Injection, Memory, Recovery
from sextant.localization.recovery.top_k import TopKInjection
from sextant.localization.recovery.uniform import UniformInjection

__all__ = [
    "AugmentedMCL",
    "BayesRestart",
    "Injection",
    "Memory",
    "NoRecovery",
    "Recovery",
    "TopKInjection",
    "UniformInjection",
]
