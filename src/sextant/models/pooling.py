"""Poolings: from the feature map of an image to one vector, each built from ``channels`` and ``size`` of the map."""

import math
import warnings
from abc import abstractmethod
from typing import Annotated

import torch
import torch.nn.functional as F
from annotated_types import Ge, Le
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.layers.cell_means import cell_means
from sextant.ranges import Count, Positive, checked

__all__ = ["Average", "FeatureMixer", "Flatten", "GeM", "NetVLAD", "Pooling"]


class Pooling(nn.Module):
    """Maps features ``(b, c, h, w)`` to ``(b, features)``.

    Args:
        channels: c.
        size: h and w.
        features: length of the vector.

    Raises:
        ValueError: there are no channels or no cells.
    """

    def __init__(self, channels: int, size: tuple[int, int], features: int):
        super().__init__()
        if channels < 1 or min(size) < 1:
            raise ValueError(f"cannot pool {channels} channels of {size[0]}x{size[1]} cells")
        self.channels, self.size, self.features = channels, (size[0], size[1]), features

    @abstractmethod
    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """One vector per image."""


class Average(Pooling):
    """Global average pooling.

    Args:
        channels, size: those of the map; any size is accepted.

    Example:
        >>> import torch
        >>> Average(channels=1, size=(2, 2))(torch.tensor([[[[0.0, 1.0], [2.0, 3.0]]]]))
        tensor([[1.5000]])
    """

    def __init__(self, channels: int, size: tuple[int, int]):
        super().__init__(channels, size, channels)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c"]:
        """Mean of each channel."""
        return x.mean((2, 3))


class Flatten(Pooling):
    """Concatenates all cells of the map, or its means over a smaller grid.

    Every position in the image has its own weights in the next layer: suitable for a camera that returns to the same
    viewpoints, unsuitable for changed viewpoints. This is the form of Lopez-Antequera et al. 2017.

    Args:
        channels, size: those of the map; other sizes are refused unless there is a grid.
        grid: height and width to average to first, which bounds the weights that follow; None keeps every cell.

    Raises:
        ValueError: the grid is empty or larger than the map.

    Example:
        >>> import torch
        >>> Flatten(channels=1, size=(2, 4), grid=(1, 2))(torch.arange(8.0).reshape(1, 1, 2, 4))  # means of the halves
        tensor([[2.5000, 4.5000]])
    """

    @checked
    def __init__(self, channels: int, size: tuple[int, int], *, grid: tuple[Count, Count] | None = None):
        height, width = size if grid is None else grid
        if not (1 <= height <= size[0] and 1 <= width <= size[1]):
            raise ValueError(f"a grid of {height}x{width} does not fit a map of {size[0]}x{size[1]}")
        super().__init__(channels, size, channels * height * width)
        self.grid = None if grid is None else (grid[0], grid[1])

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Channels of the cells, ``k = c h w``."""
        return (x if self.grid is None else cell_means(x, self.grid)).flatten(1)


SMALLEST_FEATURE = 1e-6
#: p is clamped to this range: beyond it, powers would overflow in float32, or the mean would be meaningless
P_RANGE = (1, 12)


def generalised_mean(x: Float[Tensor, "b c h w"], p: Float[Tensor, ""] | float) -> Float[Tensor, "b c"]:
    """``(mean max(x, eps)^p)^(1/p)`` over the map, computed relative to the largest feature of each channel."""
    x = x.clamp(min=SMALLEST_FEATURE)
    largest = x.detach().amax((2, 3), keepdim=True)
    return (x / largest).pow(p).mean((2, 3)).pow(1 / p) * largest[:, :, 0, 0]


class GeM(Pooling):
    r"""Generalised mean pooling: per channel :math:`\big(\frac1{hw} \sum_i \max(x_i, \epsilon)^p\big)^{1/p}`, p learnt.

    It is computed in float32 or wider.

    p = 1 is the mean, and p to infinity the maximum.

    Source: F. Radenovic et al., "Fine-tuning CNN image retrieval with no human annotation", TPAMI 2019, which starts at
    p = 3.

    Args:
        channels, size: those of the map; any size is accepted.
        p: initial value of the exponent, within :data:`P_RANGE`.
        train_p: learn the exponent.

    Raises:
        UserError: p is out of its range.

    Example:
        >>> GeM(channels=1, size=(1, 2), p=2.0)(torch.tensor([[[[1.0, 7.0]]]])).item()  # sqrt((1 + 49) / 2)
        5.0
    """

    p: Tensor

    @checked
    def __init__(
        self,
        channels: int,
        size: tuple[int, int],
        *,
        p: Annotated[float, Ge(P_RANGE[0]), Le(P_RANGE[1])] = 3.0,
        train_p: bool = True,
    ):
        super().__init__(channels, size, channels)
        self.p = nn.Parameter(torch.tensor(float(p)), requires_grad=train_p)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c"]:
        """Generalised mean of each channel; p is clamped to its range but keeps its gradient beyond."""
        p = self.p + (self.p.clamp(*P_RANGE) - self.p).detach()
        return generalised_mean(x.to(torch.promote_types(x.dtype, torch.float32)), p)


INITIAL_STD = 0.02


class MixerBlock(nn.Module):
    """One mixing of the cells of each channel, added to them.

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
    r"""Feature mixing: every channel's map is mixed as a whole, several times; then channels and cells are projected.

    The map is a matrix :math:`X \in R^{c \times n}`, n = h w, one row per channel. For each row, ``depth`` times,

    .. math:: x \leftarrow W_2\, \operatorname{ReLU}(W_1\, \operatorname{LN}(x)) + x

    with weights :math:`W_1, W_2^\top \in R^{qn \times n}`, q the ratio, shared by the rows; then
    :math:`Z = W_d X \in R^{d \times n}` mixes channels and :math:`O = Z W_r^\top \in R^{d \times r}` cells, and O is
    flattened and scaled to unit length.

    Source: A. Ali-bey et al., "MixVPR: feature mixing for visual place recognition", WACV 2023, equations 1 to 6.

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

    @checked
    def __init__(
        self,
        channels: int,
        size: tuple[int, int],
        *,
        out_channels: Count = 64,
        out_rows: Count = 4,
        depth: Count = 4,
        ratio: Positive = 1.0,
    ):
        super().__init__(channels, size, out_channels * out_rows)
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


NEAREST_OVER_SECOND = 100.0
START_ALPHA = 10.0
#: limit of alpha, which would grow without bound for centres that are almost equally far
MOST_ALPHA = 1000.0


class NetVLAD(Pooling):
    r"""NetVLAD: sums of residuals to learnt centres, each feature assigned softly.

    Without :meth:`initialise` the centres start at random directions.

    With the features :math:`x_i` of the cells at unit length, centres :math:`c_k`, and

    .. math::
        a_k(x) = \frac{e^{w_k^\top x + b_k}}{\sum_{k'} e^{w_{k'}^\top x + b_{k'}}}, \qquad
        V_k = \sum_i a_k(x_i)\,(x_i - c_k),

    each :math:`V_k` is scaled to unit length (intra-normalisation), then all of them together. With :math:`w_k =
    2\alpha c_k`, :math:`b_k = -\alpha\|c_k\|^2` the assignment is :math:`a_k \propto e^{-\alpha\|x - c_k\|^2}`. It
    starts like this; then w, b and c are learnt separately. :meth:`NetVLAD.initialise` finds the centres by k-means and
    chooses α so that, on average, the nearest centre has 100 times the weight of the second.

    Source: R. Arandjelovic et al., "NetVLAD: CNN architecture for weakly supervised place recognition", CVPR 2016; the
    100 is from the authors' code.

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

    @checked
    def __init__(self, channels: int, size: tuple[int, int], *, clusters: Annotated[int, Ge(2), Le(1024)] = 16):
        super().__init__(channels, size, channels * clusters)
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


class CellsAndVLAD(NetVLAD):
    r"""NetVLAD of the whole map joined with means over the cells of a grid: content, and content by position.

    .. math:: \Big[\frac{V}{\lVert V \rVert},\; c\,\frac{\bar x}{\lVert \bar x \rVert}\Big]

    with V from :class:`~sextant.models.pooling.NetVLAD` and the map :math:`\bar x` of cell means. The first is robust
    to a change of viewpoint; the second is robust to a change of season at the same viewpoint.

    Args:
        channels, size: those of the map; any size is accepted.
        clusters: number of centres, at least 2.
        grid: rows and columns of cells.
        cells: c, the weight of the means.

    Raises:
        UserError: there are fewer than two clusters.
    """

    @checked
    def __init__(
        self,
        channels: int,
        size: tuple[int, int],
        *,
        clusters: Annotated[int, Ge(2), Le(1024)] = 32,
        grid: tuple[Count, Count] = (4, 6),
        cells: Positive = 1.0,
    ):
        super().__init__(channels, size, clusters=clusters)
        self.grid, self.cells = (grid[0], grid[1]), cells
        self.features = channels * (clusters + grid[0] * grid[1])

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """NetVLAD of the map, then the weighted means of its cells; both in float32."""
        x = x.to(torch.promote_types(x.dtype, torch.float32))
        means = cell_means(x, self.grid).flatten(1)
        return torch.cat([super().forward(x), self.cells * F.normalize(means, dim=1)], 1)
