r"""Initialisation at the map images that the first image looks like.

A map image i is drawn with :math:`q(i) \propto e^{l(z | x_i)}`, and a particle near it from :math:`p(x | i)`. The image
z is then part of the belief already and must not weigh these particles again. The weights that make the belief the
posterior under the map's prior are

.. math:: W \propto \frac{p_0(i, x)\, e^{l(z \mid x)}}{q(i)\, p(x \mid i)} \propto e^{l(z \mid x) - l(z \mid x_i)},

which are uniform where the likelihood hardly changes over the jitter.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.belief import Belief
from sextant.localization.initialisation.initialisation import Initialisation, weighed
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence


@dataclass(frozen=True)
class AppearanceStart(Initialisation):
    """Particles at the map images that the first image looks like.

    Without a first image (no evidence, a run that has not ``seen`` one, or an image that no map image explains),
    particles are drawn from the map's prior.

    Attributes:
        top: draw from the best K images only; None for all.
        weigh_jitter: weigh each particle by how well its own pose explains the image, relative to the map image it was
            drawn at. This is exact, at the cost of one likelihood per particle; without it, weights are uniform.

    Raises:
        UserError: ``top`` is below 1.

    Example:
        >>> class AtTen(Evidence):  # what is seen looks like the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> start, prior = AppearanceStart(top=3), MapPrior(line, 0.0, 0.0)  # no jitter: at the images themselves
        >>> start.start(prior, 1, 1000, AtTen(), None, torch.Generator().manual_seed(0)).poses[..., 0].unique()
        tensor([ 9., 10., 11.], dtype=torch.float64)
    """

    top: int | None = None
    weigh_jitter: bool = False
    uses_evidence = True

    def __post_init__(self) -> None:
        if self.top is not None and self.top < 1:
            raise ArgumentError(f"top={self.top} must be at least 1", "Or null for all images of the map.")

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from q with jitter, and from the prior in runs without an image."""
        anywhere = prior.sample(runs, particles, generator)
        if evidence is None:
            return Belief.uniform(anywhere)
        proposal = AppearanceProposal.of(evidence.over_map(), self.top)
        rows, scores = proposal.draw(particles, generator)
        there = prior.around(rows, generator)
        usable = proposal.log_total.isfinite()
        if seen is not None:
            usable = usable & seen
        poses = torch.where(usable[:, None, None], there, anywhere)
        log_weights = poses.new_zeros(poses.shape[:2])
        if self.weigh_jitter:
            log_weights = torch.where(usable[:, None], evidence.log_likelihood(poses) - scores, log_weights)
        return weighed(poses, log_weights)
