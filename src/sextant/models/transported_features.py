"""SALAD: the cells of a map are assigned to clusters by optimal transport, with a dustbin for what is of no use."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError

#: of Sinkhorn's algorithm
ITERATIONS = 3


def transported(scores: Float[Tensor, "b m n"], dustbin: Float[Tensor, ""]) -> Float[Tensor, "b m n"]:
    r"""The transport plan from n cells to m clusters; a dustbin, whose row is left out, takes the rest.

    Sinkhorn's algorithm for :math:`P = \operatorname{diag}(e^u)\, e^{S}\, \operatorname{diag}(e^v)`, in logarithms:
    each cell has one unit to give, each cluster takes one, and the dustbin, of equal score z for all cells, takes
    n - m. It scales clusters, then cells, three times; so what a cell gives always adds up to one.

    Raises:
        ValueError: there are not more cells than clusters.

    >>> transported(torch.zeros(1, 1, 3), torch.tensor(0.0))  # a third of each cell
    tensor([[[0.3333, 0.3333, 0.3333]]])
    """
    count, clusters, cells = scores.shape
    if cells <= clusters:
        raise ValueError(f"{cells} cells for {clusters} clusters: there must be more cells")
    table = torch.cat([scores, dustbin.to(scores.dtype).expand(count, 1, cells)], 1)
    taken = table.new_zeros(clusters + 1)
    taken[-1] = math.log(cells - clusters)
    v = table.new_zeros(count, cells)
    for _ in range(ITERATIONS):
        u = taken - torch.logsumexp(table + v[:, None], 2)
        v = -torch.logsumexp(table + u[:, :, None], 1)
    return (table + u[:, :, None] + v[:, None])[:, :-1].exp()


class TransportedFeatures(nn.Module):
    r"""Sinkhorn algorithm for locally aggregated descriptors (SALAD).

    Two perceptrons give each cell i a feature :math:`f_i \in R^l` and scores for m clusters; the transport plan P of
    these scores (:func:`transported`) gives :math:`V_k = \sum_i P_{ki} f_i`. Each :math:`V_k` is scaled to unit length,
    so is the feature g of the image's token, and then all of them together. The order of V is that of the authors'
    files: the features of all clusters, number by number.

    Source: S. Izquierdo and J. Civera, "Optimal transport aggregation for visual place recognition", CVPR 2024. The
    names of the arrays are those of the authors' files.

    Args:
        channels: c, of map and token.
        cells: of the map, more than clusters.
        clusters: m.
        cluster_width: l.
        token_width: length of g.
        hidden: units of the perceptrons.

    Attributes:
        features: length of a descriptor, m l + token_width.

    Raises:
        UserError: there are not more cells than clusters.

    Example:
        >>> import torch
        >>> pooling = TransportedFeatures(8, 24, clusters=4, cluster_width=3, token_width=5, hidden=16)
        >>> pooling(torch.rand(2, 8, 4, 6), torch.rand(2, 8)).shape
        torch.Size([2, 17])
    """

    def __init__(
        self, channels: int, cells: int, *, clusters: int, cluster_width: int, token_width: int, hidden: int = 512
    ):
        super().__init__()
        if cells <= clusters:
            raise ArgumentError(f"a map of {cells} cells has too few for {clusters} clusters", "Use larger images.")
        self.features = clusters * cluster_width + token_width

        def perceptron(out: int) -> nn.Sequential:  # training puts dropout where the identity is
            return nn.Sequential(nn.Conv2d(channels, hidden, 1), nn.Identity(), nn.ReLU(), nn.Conv2d(hidden, out, 1))

        self.token_features = nn.Sequential(nn.Linear(channels, hidden), nn.ReLU(), nn.Linear(hidden, token_width))
        self.cluster_features, self.score = perceptron(cluster_width), perceptron(clusters)
        self.dust_bin = nn.Parameter(torch.tensor(1.0))

    def forward(self, x: Float[Tensor, "b c h w"], token: Float[Tensor, "b c"]) -> Float[Tensor, "b k"]:
        """Descriptors of unit length."""
        features = self.cluster_features(x).flatten(2)  # (b, l, n)
        plan = transported(self.score(x).flatten(2), self.dust_bin)  # (b, m, n)
        clusters = F.normalize(features @ plan.transpose(1, 2), dim=1)  # (b, l, m)
        whole = torch.cat([F.normalize(self.token_features(token), dim=1), clusters.flatten(1)], 1)
        return F.normalize(whole, dim=1)
