r"""A mixture of local Gaussian processes with different length scales of the heading.

A map of few headings hardly constrains how similar the views between them are. A kernel fitted to headings 45 degrees
apart is over- or underconfident about those in the middle. So the heading has m length scales, the learnt one times
:math:`c_1, \dots, c_m`, all equally likely. The likelihood of an image is the mean over them:

.. math:: l(z \mid x) = \log \tfrac1m \sum_{j=1}^m e^{l_j(z \mid x)}.

At the poses of the map's own images the kernels nearly agree, and the first represents all: there the log-likelihood of
the mixture is at least that of the first minus log m.

Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", 2006, section 5.2, for a sum over
hyper-parameters instead of the likeliest ones.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import torch
from annotated_types import MinLen
from jaxtyping import Float32, Float64
from torch import Tensor

from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedEvidence, CachedLocalGP, MapEvidence
from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.model import ObservationModel, Prediction, Residuals
from sextant.localization.pose_kernel import PoseKernel
from sextant.ranges import Count, Positive, checked


class KernelMixture(ObservationModel):
    """:class:`CachedLocalGP` with the mean likelihood over several length scales of the heading.

    Besides the map it takes m times the memory of one model. An observation is compared with the map's images once for
    all of them. The prediction at a pose, to which appearance noise is fitted, is a Gaussian with the mixture's mean
    and variance.

    Args:
        neighbours: k, the number of neighbours in each model.
        map_evidence: see :class:`CachedLocalGP`.
        headings: c, the factors of the kernel's length in the heading.
        rounded: see :class:`CachedLocalGP`.

    Raises:
        UserError: there is no factor, or one that is not above 0.
        ValueError: ``map_evidence`` is unknown.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 0.8]], dtype=torch.float64)  # two views, 45 degrees apart
        >>> places, kernel = DescriptorMap.of(poses, torch.eye(2)), PoseKernel("rbf", (3.0, 3.0), 0.2, 1.0, 0.01)
        >>> between = torch.tensor([[[0.0, 0.0, 0.4]]], dtype=torch.float64)
        >>> for headings in ([1.0], [1.0, 4.0]):  # a view between them is better explained by the longer length
        ...     model = KernelMixture(neighbours=2, headings=headings).fit(places, kernel)
        ...     told = model.observe(torch.tensor([[0.5, 0.5]]), Likelihood()).log_likelihood(between)
        ...     print(f"{float(told):.1f}")
        -1.8
        0.5
    """

    @checked
    def __init__(
        self,
        neighbours: Count = 16,
        map_evidence: MapEvidence = "mean",
        headings: Annotated[Sequence[Positive], MinLen(1)] = (1.0, 4.0),
        rounded: bool = False,
    ):
        self.neighbours, self.map_evidence, self.headings = neighbours, map_evidence, [float(c) for c in headings]
        self.rounded = rounded
        self.parts = [  # observations are compared by the first
            CachedLocalGP(neighbours, map_evidence=map_evidence, rounded=rounded and j == 0)
            for j in range(len(headings))
        ]

    def _fit(self) -> None:
        for part, kernel in zip(self.parts, self._kernels(), strict=True):
            part.fit(self.map, kernel)

    def _kernels(self) -> list[PoseKernel]:
        return [replace(self.kernel, heading_length=c * self.kernel.heading_length) for c in self.headings]

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """The Gaussian with the mixture's mean and its variance, averaged over dimensions."""
        of_parts = [part.predict(poses) for part in self.parts]
        means = torch.stack([one.mean for one in of_parts])
        mean, within = means.mean(0), torch.stack([one.variance for one in of_parts]).mean(0)
        return Prediction(mean, within + (means - mean).square().mean((0, 2)))

    def residuals_over_map(self, descriptors: Float32[Tensor, "r d"]) -> Residuals:
        """See :class:`ObservationModel`; uses the first kernel."""
        return self.parts[0].residuals_over_map(descriptors)

    def observe(self, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood) -> "MixtureEvidence":
        """See :class:`ObservationModel`."""
        first = self.parts[0].observe(descriptors, likelihood)
        return MixtureEvidence([first, *(first.under(part) for part in self.parts[1:])])

    def state(self) -> dict[str, Tensor]:
        """See :class:`ObservationModel`."""
        return {f"{name}_{j}": held for j, part in enumerate(self.parts) for name, held in part.state().items()}

    def _load(self, state: dict[str, Tensor]) -> None:
        for j, (part, kernel) in enumerate(zip(self.parts, self._kernels(), strict=True)):
            of_part = {name.removesuffix(f"_{j}"): held for name, held in state.items() if name.endswith(f"_{j}")}
            part.load_state(self.map, kernel, of_part)


class MixtureEvidence(Evidence):
    """The mean likelihood of one observation under several models."""

    def __init__(self, parts: Sequence[CachedEvidence]):
        self.parts = parts

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        return torch.stack([part.log_likelihood(poses) for part in self.parts]).logsumexp(0) - math.log(len(self.parts))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`; uses the first model."""
        return self.parts[0].over_map()
