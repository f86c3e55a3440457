"""Recovery: particles placed elsewhere, for a robot that is not where the filter believes it to be."""

from sextant.localization.recovery.augmented import AugmentedMCL
from sextant.localization.recovery.bayes_restart import BayesRestart
from sextant.localization.recovery.metric_proposal import MetricProposal
from sextant.localization.recovery.recovery import Injection, Memory, NoRecovery, Recovery, UniformInjection
from sextant.localization.recovery.top_k import TopKInjection

__all__ = [
    "AugmentedMCL",
    "BayesRestart",
    "Injection",
    "Memory",
    "MetricProposal",
    "NoRecovery",
    "Recovery",
    "TopKInjection",
    "UniformInjection",
]
