"""No way back for a filter that is lost."""

from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.localization.map_prior import MapPrior
from sextant.localization.recovery.recovery import Injection, Recovery
from sextant.localization.weighed import Weighed


@dataclass(frozen=True)
class NoRecovery(Recovery):
    """Adds nothing."""

    def inject(
        self, weighed: Weighed, prior: MapPrior, memory: Float64[Tensor, "r s"], generator: torch.Generator
    ) -> tuple[Injection | None, Float64[Tensor, "r s"]]:
        """Nothing."""
        return None, memory
