"""Initialisation: the belief a filter starts from."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.geometry.planar import wrap_angle
from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.belief import Belief
from sextant.localization.map_prior import MapPrior
from sextant.localization.observation.evidence import Evidence
from sextant.ranges import NonNegative, checked
from sextant.shapes import check_shape

__all__ = ["AppearanceStart", "GaussianStart", "Initialisation", "UniformStart"]


class Initialisation(ABC):
    """Makes the first belief of r runs."""

    #: Whether the first belief includes the first image, which must then not weight it again.
    uses_evidence: bool = False

    @abstractmethod
    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """The first belief.

        Args:
            prior: distribution of poses before the first observation.
            runs: r, the number of runs.
            particles: number of particles in each run.
            evidence: evidence of the first image of each run, for initialisations that use it.
            seen: in which runs there is an image; None for all.
            generator: generator of random numbers.
        """


@dataclass(frozen=True)
class UniformStart(Initialisation):
    """Particles drawn from the map's prior, weighted by the first image in the first step.

    Example:
        >>> exact = MapPrior(torch.tensor([[0.0, 0, 0], [5, 0, 0]], dtype=torch.float64), 0.0, 0.0)
        >>> belief = UniformStart().start(exact, 1, 100, None, None, torch.Generator().manual_seed(0))
        >>> belief.poses[..., 0].unique()  # without jitter they are at the images themselves
        tensor([0., 5.], dtype=torch.float64)
    """

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from the prior, with equal weights."""
        return Belief.uniform(prior.sample(runs, particles, generator))


@checked
@dataclass(frozen=True)
class GaussianStart(Initialisation):
    """Particles around one pose in each run, weighted by the first image in the first step.

    Attributes:
        mean: the pose of each run, or one pose for all.
        sigma: standard deviations of x, y (metres, axes of the map) and heading (rad).

    Raises:
        UserError: a deviation is negative or not finite, or a pose is not x, y and heading.
        ValueError: a pose is not finite.

    Example:
        >>> pose = torch.tensor([[3.0, 0.0, 0.0]], dtype=torch.float64)
        >>> start = GaussianStart(pose, sigma=(0.5, 0.2, 0.0))  # the heading is known
        >>> belief = start.start(MapPrior(pose, 0.5, 0.1), 1, 10_000, None, None, torch.Generator().manual_seed(0))
        >>> belief.poses[0].std(0).round(decimals=1)
        tensor([0.5000, 0.2000, 0.0000], dtype=torch.float64)
    """

    mean: Float64[Tensor, "r 3"]
    sigma: tuple[NonNegative, NonNegative, NonNegative]

    def __post_init__(self) -> None:
        check_shape("mean", torch.atleast_2d(self.mean), "r", 3)
        if not bool(self.mean.isfinite().all()):
            raise ValueError("a pose to start from is not finite")

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from the Gaussians, with equal weights.

        Raises:
            ArgumentError: there are several poses, but not one for each run.
        """
        if self.mean.ndim == 2 and len(self.mean) != 1:
            check_shape("mean", self.mean, runs, 3)
        mean = self.mean.expand(runs, 3)[:, None]
        noise = torch.randn(runs, particles, 3, generator=generator, dtype=mean.dtype, device=mean.device)
        poses = mean + noise * mean.new_tensor(self.sigma)
        return Belief.uniform(torch.cat([poses[..., :2], wrap_angle(poses[..., 2:])], dim=2))


@dataclass(frozen=True)
class AppearanceStart(Initialisation):
    r"""Particles at the map images most similar to the first image.

    A map image i is drawn with :math:`q(i) \propto e^{l(z | x_i)}`, and a particle near it from :math:`p(x | i)`. The
    belief then already includes the image z, which must not weight these particles again. The weights that make the
    belief the posterior under the map's prior are

    .. math:: W \propto \frac{p_0(i, x)\, e^{l(z \mid x)}}{q(i)\, p(x \mid i)} \propto e^{l(z \mid x) - l(z \mid x_i)}.

    All particles get the same weight, as the likelihood hardly changes over the jitter.

    Without a first image (no evidence, a run not in ``seen``, or an image that no map image explains), particles are
    drawn from the map's prior.

    Example:
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -5 * (poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> start, prior = AppearanceStart(), MapPrior(line, 0.0, 0.0)  # no jitter: at the images themselves
        >>> start.start(prior, 1, 1000, AtTen(), None, torch.Generator().manual_seed(0)).poses[..., 0].unique()
        tensor([ 9., 10., 11.], dtype=torch.float64)
    """

    uses_evidence = True

    def start(
        self,
        prior: MapPrior,
        runs: int,
        particles: int,
        evidence: Evidence | None,
        seen: Bool[Tensor, "r"] | None,
        generator: torch.Generator,
    ) -> Belief:
        """Draw from q with jitter, and from the prior in runs without an image.

        Raises:
            ArgumentError: the evidence is that of more or fewer runs.
        """
        anywhere = prior.sample(runs, particles, generator)
        if evidence is None:
            return Belief.uniform(anywhere)
        over_map = evidence.over_map()
        check_shape("over_map", over_map, runs, "n")
        proposal = AppearanceProposal.of(over_map)
        rows, _ = proposal.draw(particles, generator)
        there = prior.around(rows, generator)
        usable = proposal.log_total.isfinite()
        if seen is not None:
            usable = usable & seen
        poses = torch.where(usable[:, None, None], there, anywhere)
        return Belief.of(poses, poses.new_zeros(poses.shape[:2]))
