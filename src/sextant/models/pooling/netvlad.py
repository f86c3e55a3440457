r"""NetVLAD: sums of residuals to learnt centres, each feature assigned softly.

With the features :math:`x_i` of the cells at unit length, centres :math:`c_k`, and

.. math::
    a_k(x) = \frac{e^{w_k^\top x + b_k}}{\sum_{k'} e^{w_{k'}^\top x + b_{k'}}}, \qquad
    V_k = \sum_i a_k(x_i)\,(x_i - c_k),

each :math:`V_k` is brought to unit length (intra-normalisation), then all of them together. With
:math:`w_k = 2\alpha c_k`, :math:`b_k = -\alpha\|c_k\|^2` the assignment is
:math:`a_k \propto e^{-\alpha\|x - c_k\|^2}`. It starts like this; then w, b and c are learnt separately.
:meth:`NetVLAD.initialise` finds the centres by k-means and chooses α so that, on average, the nearest centre has 100
times the weight of the second.

Source: R. Arandjelovic et al., "NetVLAD: CNN architecture for weakly supervised place recognition", CVPR 2016; the 100
is from the authors' code.
"""

import math
import warnings

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.pooling.pooling import Pooling

NEAREST_OVER_SECOND = 100.0
START_ALPHA = 10.0
#: largest alpha: where centres are almost equally far, no assignment would be hard enough
MOST_ALPHA = 1000.0


class NetVLAD(Pooling):
    """NetVLAD; see the module. Without :meth:`initialise` the centres start at random directions.

    Args:
        channels, size: those of the map; any size is accepted.
        clusters: number of centres, at least 2.

    Raises:
        UserError: there are fewer than two clusters.

    Example:
        >>> pooling, features = NetVLAD(channels=8, size=(4, 6), clusters=4), torch.rand(2, 8, 4, 6)
        >>> pooling(features).shape
        torch.Size([2, 32])
        >>> torch.allclose(pooling(features), pooling(features.flip(3)), atol=1e-6)  # it does not matter where
        True
    """

    def __init__(self, channels: int, size: tuple[int, int], *, clusters: int = 16):
        super().__init__(channels, size, channels * clusters)
        if clusters < 2:
            raise ArgumentError(f"clusters={clusters} must be at least 2", "For example clusters=16")
        self.centres = nn.Parameter(F.normalize(torch.randn(clusters, channels), dim=1))
        self.assignment = nn.Linear(channels, clusters)
        self._assign_to_centres(START_ALPHA)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Normalised residuals, clusters x channels."""
        cells = F.normalize(x.flatten(2).transpose(1, 2), dim=2)  # (b, h w, c)
        share = self.assignment(cells).softmax(2)  # (b, h w, clusters)
        residuals = share.transpose(1, 2) @ cells - share.sum(1)[..., None] * self.centres
        return F.normalize(F.normalize(residuals, dim=2).flatten(1), dim=1)

    @torch.no_grad()
    def initialise(self, features: Float[Tensor, "n c"], seed: int = 0) -> float:
        """Set centres and assignment by k-means of features sampled from maps; returns α.

        Args:
            features: features of single cells, of any norm, from many images.
            seed: seed of k-means.

        Raises:
            ValueError: there are fewer features than clusters, they have other channels, or one is not finite.
        """
        from sklearn.cluster import KMeans
        from sklearn.exceptions import ConvergenceWarning

        clusters = len(self.centres)
        if len(features) < clusters or features.shape[1] != self.channels:
            raise ValueError(f"{clusters} centres of {self.channels} channels from {tuple(features.shape)} features")
        if not bool(features.isfinite().all()):
            raise ValueError("a feature is not finite")
        unit = F.normalize(features.float(), dim=1)
        with warnings.catch_warnings():  # fewer distinct features than centres: some centres are equal
            warnings.simplefilter("ignore", ConvergenceWarning)
            found = KMeans(clusters, n_init=1, random_state=seed).fit(unit.cpu().numpy()).cluster_centers_
        self.centres.copy_(torch.from_numpy(found))
        squared = torch.cdist(unit, self.centres.to(unit)).square()
        nearest, second = squared.topk(2, dim=1, largest=False).values.unbind(1)
        gap = float((second - nearest).mean())
        alpha = min(math.log(NEAREST_OVER_SECOND) / max(gap, 1e-12), MOST_ALPHA)
        self._assign_to_centres(alpha)
        return alpha

    @torch.no_grad()
    def _assign_to_centres(self, alpha: float) -> None:
        self.assignment.weight.copy_(2 * alpha * self.centres)
        self.assignment.bias.copy_(-alpha * self.centres.square().sum(1))
