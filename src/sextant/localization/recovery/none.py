"""No recovery: a filter that is lost stays lost."""

from dataclasses import dataclass

import torch

from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Memory, Recovery
from sextant.localization.weighed import Weighed


@dataclass(frozen=True)
class NoRecovery(Recovery):
    """Adds nothing.

    Example:
        >>> NoRecovery().memory(runs=3) is None  # it remembers nothing either
        True
    """

    def inject(
        self, weighed: Weighed, prior: MapPrior, memory: Memory, generator: torch.Generator
    ) -> tuple[Injection | None, Memory]:
        """Add nothing."""
        return None, memory
