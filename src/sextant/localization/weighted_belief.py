"""A belief weighted by an observation, the input of recoveries."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from sextant.localization.belief import Belief
from sextant.localization.motion_density import Predicted
from sextant.localization.observation.evidence import Evidence
from sextant.shapes import check_shape


@dataclass(frozen=True)
class WeightedBelief:
    r"""Particles before and after one observation in each run.

    Attributes:
        belief: after the motion, before the observation.
        log_likelihood: :math:`l(z | x)` of each particle; 0 in runs without an observation, -inf where it is not
            finite.
        seen: which runs have an observation.
        evidence: evidence of their observations.
        predicted: the density that the particles were drawn from; None before the first motion.
    """

    belief: Belief
    log_likelihood: Float64[Tensor, "r p"]
    seen: Bool[Tensor, "r"]
    evidence: Evidence
    predicted: Predicted | None = None

    @classmethod
    def of(
        cls,
        belief: Belief,
        evidence: Evidence,
        seen: Bool[Tensor, "r"] | None,
        predicted: Predicted | None = None,
    ) -> "WeightedBelief":
        """Evaluate the evidence at every particle; ``seen`` None means all runs.

        Raises:
            ArgumentError: the evidence is not one value for each particle.
        """
        runs = len(belief.log_weights)
        seen = torch.ones(runs, dtype=torch.bool, device=belief.poses.device) if seen is None else seen
        told = evidence.log_likelihood(belief.poses)
        check_shape("log_likelihood", told, *belief.log_weights.shape)
        told = torch.where(told.isfinite(), told, -torch.inf)
        return cls(belief, torch.where(seen[:, None], told, 0.0), seen, evidence, predicted)

    @property
    def log_weights(self) -> Float64[Tensor, "r p"]:
        r""":math:`\log W_i + l(z | x_i)`, not normalised."""
        return self.belief.log_weights + self.log_likelihood

    @property
    def log_evidence(self) -> Float64[Tensor, "r"]:
        r""":math:`\log \sum_i W_i e^{l(z | x_i)}`: how well the belief predicted the observation."""
        return self.log_weights.logsumexp(1)

    @property
    def particles(self) -> Int64[Tensor, "r"]:
        """The number of particles that carried weight before the observation."""
        return (self.belief.log_weights > -torch.inf).sum(1)
