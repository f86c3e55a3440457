"""Bag of queries: learnt queries look up what they stand for in the cells of a map."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.pooling import Pooling

#: channels of one attention head
HEAD = 64


class QueryBlock(nn.Module):
    """One encoder layer of the cells, and the queries that attend to them.

    Args:
        channels: d, a multiple of 64.
        queries: q.
    """

    def __init__(self, channels: int, queries: int):
        super().__init__()
        heads = channels // HEAD
        self.encoder = nn.TransformerEncoderLayer(channels, heads, 4 * channels, dropout=0.0, batch_first=True)
        self.queries = nn.Parameter(torch.randn(1, queries, channels))
        self.self_attn = nn.MultiheadAttention(channels, heads, batch_first=True)
        self.norm_q = nn.LayerNorm(channels)
        self.cross_attn = nn.MultiheadAttention(channels, heads, batch_first=True)
        self.norm_out = nn.LayerNorm(channels)

    def forward(self, cells: Float[Tensor, "b n d"]) -> tuple[Float[Tensor, "b n d"], Float[Tensor, "b q d"]]:
        """The encoded cells, and what each query found in them."""
        cells, own = self.encoder(cells), self.queries
        asked = self.norm_q(own + self.self_attn(own, own, own, need_weights=False)[0])  # the same for all images
        found, _ = self.cross_attn(asked.expand(cells.shape[0], -1, -1), cells, cells, need_weights=False)
        return cells, self.norm_out(found)


class BagOfQueries(Pooling):
    r"""Bag of queries (BoQ).

    The map is projected to d channels by a 3 x 3 convolution; its n cells :math:`X^0 \in R^{n \times d}`, normalised,
    pass through L blocks. With multi-head attention :math:`A(Q, K, V)`, layer normalisation N and the learnt queries
    :math:`Q^l \in R^{q \times d}` of a block,

    .. math::
        X^l = \operatorname{Encoder}^l(X^{l-1}), \qquad
        \tilde Q^l = N(Q^l + A(Q^l, Q^l, Q^l)), \qquad
        O^l = N(A(\tilde Q^l, X^l, X^l)).

    All outputs together, :math:`O \in R^{Lq \times d}`, are projected to :math:`W O \in R^{r \times d}`, flattened
    channel by channel, and scaled to unit length. An encoder is one transformer layer, normalised after each sum, with
    4 d hidden units.

    Source: A. Ali-bey et al., "BoQ: A place is worth a bag of learnable queries", CVPR 2024. The names of the arrays
    are those of the authors' files.

    Args:
        channels, size: those of the map; any size is accepted.
        width: d, a multiple of 64.
        queries: q.
        layers: L.
        rows: r.

    Raises:
        UserError: a number is below 1, or d is not a multiple of 64.

    Example:
        >>> import torch
        >>> pooling = BagOfQueries(channels=8, size=(4, 6), width=64, queries=5, layers=2, rows=3).eval()
        >>> pooling(torch.rand(2, 8, 4, 6)).shape
        torch.Size([2, 192])
    """

    def __init__(self, channels: int, size: tuple[int, int], *, width: int, queries: int, layers: int, rows: int):
        super().__init__(channels, size, width * rows)
        for name, value in (("queries", queries), ("layers", layers), ("rows", rows)):
            if value < 1:
                raise ArgumentError(f"{name}={value} must be at least 1", f"For example {name}=2")
        if width < HEAD or width % HEAD:
            raise ArgumentError(f"width={width} must be a multiple of {HEAD}", "For example width=384")
        self.proj_c = nn.Conv2d(channels, width, 3, padding=1)
        self.norm_input = nn.LayerNorm(width)
        self.boqs = nn.ModuleList([QueryBlock(width, queries) for _ in range(layers)])
        self.fc = nn.Linear(layers * queries, rows)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Descriptors of unit length."""
        cells = self.norm_input(self.proj_c(x).flatten(2).transpose(1, 2))
        found = []
        for block in self.boqs:
            cells, answers = block(cells)
            found.append(answers)
        return F.normalize(self.fc(torch.cat(found, 1).transpose(1, 2)).flatten(1), dim=1)
