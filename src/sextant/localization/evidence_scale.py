r"""Tempering of the images' likelihood by how well they distinguish the places of the map.

A likelihood that was not fitted to another drive reflects neither how similar images of one place are in another season
nor how independent consecutive images are. It is overconfident in one world and uninformative in the next. Its scale is
therefore derived from the map. With the log-likelihoods :math:`\ell_i` of an image at the images i of the map and the
running mean :math:`\bar s` of their spread :math:`s = \ell_{97.5} - \ell_{2.5}`, it is tempered by

.. math:: \beta = \min\!\Big(1,\; \frac{\log \delta}{\bar s}\Big) :

whatever the descriptor, one of the most similar places of the map becomes :math:`\delta` times as likely as one of the
least similar, or less where the likelihood itself hardly differs. (Without odometry, :mod:`.adaptation` tempers by the
root of :math:`\beta`.) The spread of an image is weighted by how far the robot has moved since the last one, as in
:class:`~sextant.localization.appearance_change.AppearanceChange`.

Source: M. Xu, N. Sünderhauf, M. Milford, "Probabilistic Visual Place Recognition for Hierarchical Localization", RA-L
2021, for the quantiles, with :math:`\delta = 5` and the descriptor distances of a drive's first image. With as few as a
thousand particles, 5 starts too slowly in a town of 800 images; 10 and 20 do not.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import torch
from jaxtyping import Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.constants import ODDS
from sextant.localization.observation.evidence import Evidence

#: number of evenly spaced map images that are compared
LOOKED_AT = 4096


@dataclass(frozen=True)
class EvidenceScale:
    r"""The scale estimated from the images of the drives of r runs so far.

    Attributes:
        odds: :math:`\delta`, above 1.
        spread: :math:`\bar s` in nats.
        images: sum of the images' weights.

    Raises:
        ArgumentError: the odds are not above 1 and finite.

    >>> seen, weight = torch.linspace(-1000.0, 0.0, 1001).double()[None], torch.ones(1).double()
    >>> scale = EvidenceScale.none(1, odds=5.0).updated(seen, weight)
    >>> float(scale.spread), round(float(scale.tempering * scale.spread), 3)  # log 5
    (950.0, 1.609)
    """

    odds: float
    spread: Float64[Tensor, " r"]
    images: Float64[Tensor, " r"]

    def __post_init__(self) -> None:
        if not 1 < self.odds < math.inf:
            raise ArgumentError(f"odds={self.odds} must be above 1 and finite", "odds=5")

    @classmethod
    def none(cls, runs: int, odds: float = ODDS, device: torch.device | None = None) -> Self:
        """The state before the first image."""
        nothing = torch.zeros(runs, dtype=torch.float64, device=device)
        return cls(odds, nothing, nothing)

    def updated(self, over_map: Float64[Tensor, "r n"], weight: Float64[Tensor, " r"]) -> Self:
        """The scale after one more image of each run, given its log-likelihoods over the map.

        Those that are not finite are ignored; a run with fewer than two others keeps its scale.
        """
        some = over_map[:, :: -(-over_map.shape[1] // LOOKED_AT)]
        finite = some.isfinite()
        low, high = torch.nanquantile(some.where(finite, torch.nan), some.new_tensor([0.025, 0.975]), dim=1)
        images = self.images + weight
        step = torch.where(images > 0, weight / images, 0.0)
        known = finite.sum(1) >= 2
        spread = torch.where(known, self.spread + step * (high - low - self.spread), self.spread)
        return replace(self, spread=spread, images=torch.where(known, images, self.images))

    @property
    def tempering(self) -> Float64[Tensor, " r"]:
        r""":math:`\beta`, at most 1."""
        return torch.where(self.spread > 0, torch.full_like(self.spread, math.log(self.odds)) / self.spread, 1.0).clamp(
            max=1.0
        )


class ScaledEvidence(Evidence):
    """Evidence whose log-likelihoods are tempered.

    Args:
        evidence: the evidence to be tempered.
        over_map: its log-likelihoods at the images of the map, already computed.
        tempering: the factor of the log-likelihoods of each run.

    Example:
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> scaled = ScaledEvidence(AtTen(), AtTen().over_map(), tempering=torch.tensor([0.25]).double())
        >>> scaled.log_likelihood(line[None, 6:10]).tolist()  # a quarter of -16, -9, -4 and -1
        [[-4.0, -2.25, -1.0, -0.25]]
    """

    def __init__(self, evidence: Evidence, over_map: Float64[Tensor, "r n"], tempering: Float64[Tensor, " r"]):
        self.evidence, self._over_map, self.tempering = evidence, over_map, tempering[:, None]

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`."""
        return self.tempering * self._over_map

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        return self.tempering * self.evidence.log_likelihood(poses)
