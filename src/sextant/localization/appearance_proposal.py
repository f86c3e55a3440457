r"""A proposal distribution over map images, by how well they explain an observation.

.. math:: q(i) = \frac{e^{l(z \mid x_i)}}{\sum_{j \in C} e^{l(z \mid x_j)}}, \; i \in C, \qquad
   \log Z = \log \frac1N \sum_{j=1}^N e^{l(z \mid x_j)}

where C holds all images of the map, or the best K. Z is the evidence of z under a uniform prior over the map's poses.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int64
from torch import Tensor


@dataclass(frozen=True)
class AppearanceProposal:
    r"""The distribution q of r runs, made with :meth:`of`.

    Attributes:
        log_scores: :math:`l(z | x_i)` of the images in C; -inf for images that cannot be drawn.
        cumulative: cumulative sums of :math:`e^l` over C, relative to the run's best image.
        log_total: :math:`\log \sum_C e^l`; -inf where no image explains the observation at all.
        log_evidence: :math:`\log Z`.
        images: N, the number of images in the map.
        rows: rows of the images in C; None for all.

    Example:
        >>> proposal = AppearanceProposal.of(torch.tensor([[0.5, 0.0, 0.25, 0.25]], dtype=torch.float64).log())
        >>> proposal.log_evidence.exp()  # the mean over the map
        tensor([0.2500], dtype=torch.float64)
        >>> rows, _ = proposal.draw(4, torch.Generator())
        >>> rows  # stratified: in proportion, and never the second image
        tensor([[0, 0, 2, 3]])
    """

    log_scores: Float64[Tensor, "r c"]
    cumulative: Float64[Tensor, "r c"]
    log_total: Float64[Tensor, "r"]
    log_evidence: Float64[Tensor, "r"]
    images: int
    rows: Int64[Tensor, "r c"] | None = None

    @classmethod
    def of(cls, log_likelihood: Float64[Tensor, "r n"], top: int | None = None) -> "AppearanceProposal":
        """Build the proposal from :meth:`Evidence.over_map`; images whose value is not finite are never drawn.

        Args:
            log_likelihood: log-likelihood of each run's observation at the pose of every image.
            top: K; None for all images.
        """
        images = log_likelihood.shape[1]
        best = log_likelihood.amax(1, keepdim=True)
        if not bool(best.isfinite().all()):  # search for nan and inf only where the maximum shows one
            log_likelihood = torch.where(log_likelihood.isfinite(), log_likelihood, -torch.inf)
            best = log_likelihood.amax(1, keepdim=True)
        base = torch.where(best.isfinite(), best, 0.0)
        cumulative = (log_likelihood - base).exp_().cumsum_(1)
        log_total = (cumulative[:, -1:].log() + base)[:, 0]
        log_evidence = log_total - math.log(images)
        if top is None or top >= images:
            return cls(log_likelihood, cumulative, log_total, log_evidence, images)
        scores, rows = log_likelihood.topk(top, dim=1)
        cumulative = (scores - base).exp_().cumsum_(1)
        log_total = (cumulative[:, -1:].log() + base)[:, 0]
        return cls(scores, cumulative, log_total, log_evidence, images, rows)

    def draw(
        self, count: int | Int64[Tensor, "r"], generator: torch.Generator
    ) -> tuple[Int64[Tensor, "r k"], Float64[Tensor, "r k"]]:
        r"""Draw rows of the map from q by stratified sampling, and return them with their :math:`l(z | x_i)`.

        :math:`\log q(i)` is the latter minus ``log_total``. Where ``log_total`` is -inf there is nothing to draw, and
        the run's rows are meaningless.

        Args:
            count: number of draws, one for all runs or one for each. In the second case the result is as wide as the
                largest count, and entries beyond a run's own count are meaningless.
            generator: generator of random numbers.
        """
        device = self.cumulative.device
        counts = torch.as_tensor(count, device=device).expand(len(self.cumulative))[:, None]
        width = int(counts.max())
        jitter = torch.rand(len(counts), width, generator=generator, dtype=torch.float64, device=device)
        quantiles = (torch.arange(width, device=device) + jitter) / counts.clamp(min=1)
        total = self.cumulative[:, -1:].contiguous()
        last = torch.searchsorted(self.cumulative, total)  # images after it have no weight
        place = torch.searchsorted(self.cumulative, quantiles * total, right=True).minimum(last)
        scores = self.log_scores.gather(1, place)
        return (place if self.rows is None else self.rows.gather(1, place)), scores
