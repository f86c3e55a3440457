r"""Feature mixing: every channel's map is mixed as a whole, several times; then channels and cells are projected.

The map is a matrix :math:`X \in R^{c \times n}`, n = h w, one row per channel. For each row, ``depth`` times,

.. math:: x \leftarrow W_2\, \operatorname{ReLU}(W_1\, \operatorname{LN}(x)) + x

with weights :math:`W_1, W_2^\top \in R^{qn \times n}`, q the ratio, shared by the rows; then
:math:`Z = W_d X \in R^{d \times n}` mixes channels and :math:`O = Z W_r^\top \in R^{d \times r}` cells, and O is
flattened and brought to unit length.

Source: A. Ali-bey et al., "MixVPR: feature mixing for visual place recognition", WACV 2023, equations 1 to 6.
"""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.pooling.pooling import Pooling

INITIAL_STD = 0.02


class MixerBlock(nn.Module):
    """One mixing of the cells of each channel, added to them; see the module.

    Args:
        cells: n.
        hidden: units between the two linear layers.
    """

    def __init__(self, cells: int, hidden: int):
        super().__init__()
        self.norm = nn.LayerNorm(cells)
        self.widen, self.narrow = nn.Linear(cells, hidden), nn.Linear(hidden, cells)
        for linear in (self.widen, self.narrow):  # small, so that a block starts near the identity
            nn.init.trunc_normal_(linear.weight, std=INITIAL_STD)
            nn.init.zeros_(linear.bias)

    def forward(self, x: Float[Tensor, "b c n"]) -> Float[Tensor, "b c n"]:
        """Mixed cells of each channel."""
        return x + self.narrow(F.relu(self.widen(self.norm(x))))  # type: ignore[no-any-return]


class FeatureMixer(Pooling):
    """Feature mixing; see the module.

    Args:
        channels, size: those of the map; other sizes are refused.
        out_channels: d.
        out_rows: r.
        depth: number of mixings.
        ratio: number of hidden units of a mixing, divided by the number of cells.

    Raises:
        UserError: a number is below 1, or the ratio leaves no hidden unit.

    Example:
        >>> import torch
        >>> descriptor = FeatureMixer(channels=8, size=(4, 6), out_channels=16, out_rows=4)(torch.rand(2, 8, 4, 6))
        >>> descriptor.shape, torch.allclose(descriptor.norm(dim=1), torch.ones(2))
        (torch.Size([2, 64]), True)
    """

    def __init__(
        self,
        channels: int,
        size: tuple[int, int],
        *,
        out_channels: int = 64,
        out_rows: int = 4,
        depth: int = 4,
        ratio: float = 1.0,
    ):
        super().__init__(channels, size, out_channels * out_rows)
        for name, value in (("out_channels", out_channels), ("out_rows", out_rows), ("depth", depth)):
            if value < 1:
                raise ArgumentError(f"{name}={value} must be at least 1", f"For example {name}=4")
        cells = size[0] * size[1]
        if not 1 <= cells * ratio < float("inf"):
            raise ArgumentError(f"ratio={ratio} leaves no hidden unit for {cells} cells", "ratio=1")
        self.mix = nn.Sequential(*[MixerBlock(cells, int(cells * ratio)) for _ in range(depth)])
        self.project_channels, self.project_cells = nn.Linear(channels, out_channels), nn.Linear(cells, out_rows)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Mixed and projected features of unit length."""
        mixed = self.mix(x.flatten(2))
        projected = self.project_cells(self.project_channels(mixed.transpose(1, 2)).transpose(1, 2))
        return F.normalize(projected.flatten(1), dim=1)
