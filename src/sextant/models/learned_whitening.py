r"""Learned whitening: the linear map that best separates places across conditions, in closed form.

Let :math:`x_{ic}` be features of place i under condition c, :math:`\mu` their mean over all, and
:math:`y = P (x - \mu)` their first principal components. With :math:`\bar y_i` the mean of a place,

.. math:: S_W = \langle (y_{ic} - \bar y_i)(y_{ic} - \bar y_i)^\top \rangle, \quad
   S_B = \langle \bar y_i \bar y_i^\top \rangle, \qquad S_B v = \lambda (S_W + \gamma \bar S_W I) v,

where :math:`\bar S_W` is the mean of the diagonal. The vectors v of the largest λ, of norm one in the lifted
:math:`S_W`, are the rows of V; the map is :math:`V P (x - \mu)`. Unlike a layer trained by gradient descent it has one
optimum, and γ limits overfitting to few places.

Sources: K. Mikolajczyk and J. Matas, "Improving descriptors for fast tree matching by optimal linear projection", ICCV
2007; F. Radenović, G. Tolias, O. Chum, "Fine-tuning CNN image retrieval with no human annotation", PAMI 2018; the ridge
as in J. H. Friedman, "Regularized discriminant analysis", JASA 1989.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64
from torch import Tensor


def learned_whitening(
    features: Float[Tensor, "n d"],
    place: Int64[Tensor, "n"],
    dimension: int,
    *,
    components: int = 256,
    shrinkage: float = 1.0,
) -> tuple[Float[Tensor, "k d"], Float[Tensor, "k"]]:
    """Weight and bias of the map, as a linear layer takes them; see the module.

    Where the features vary in fewer than k directions (channels may be dead), the last rows are zero.

    Args:
        features: features of places, each with two or more images.
        place: index of each image's place, from 0 on without gaps.
        dimension: k, the number of outputs.
        components: number of principal components considered; fewer where the features do not span as many.
        shrinkage: γ, above 0.

    Raises:
        ValueError: a place has a single image; ``components``, features or images are fewer than k; no place has
            features that differ; or the shrinkage is not above 0.
    """
    images = place.bincount()
    if len(images) == 0 or int(images.min()) < 2 or not shrinkage > 0:
        raise ValueError(f"need two or more images of every place, and a shrinkage above 0, got {shrinkage}")
    mean = features.float().mean(0)
    centred = features.float() - mean
    most = min(components, features.shape[1], len(features) - 1)
    if most < dimension:
        raise ValueError(
            f"{components} components of {len(features)} images with {features.shape[1]} features span {most} "
            f"directions at most; {dimension} are needed"
        )
    axes = _principal_axes(centred, most)
    y = (centred @ axes.float()).double()
    centre = y.new_zeros(len(images), y.shape[1]).index_add_(0, place, y) / images[:, None]
    apart = y - centre[place]
    within, between = apart.T @ apart / len(apart), centre.T @ centre / len(centre)
    if not within.diagonal().sum() > 0:
        raise ValueError("the features of no place differ between its images, or they are not finite")
    within += shrinkage * within.diagonal().mean() * torch.eye(len(within), dtype=within.dtype, device=within.device)
    # with the lifted S_W = L L', the problem is an ordinary one in L' v
    lower = torch.linalg.cholesky(within)
    half = torch.linalg.solve_triangular(lower, between, upper=False)
    _, vectors = torch.linalg.eigh(torch.linalg.solve_triangular(lower, half.T, upper=False))
    directions = torch.linalg.solve_triangular(lower.T, vectors[:, -dimension:].flip(1), upper=True)
    weight = F.pad((axes @ directions).T.float(), (0, 0, 0, dimension - directions.shape[1])).contiguous()
    return weight, -(weight @ mean)


def _principal_axes(centred: Float[Tensor, "n d"], count: int) -> Float[Tensor, "d p"]:
    """Directions of most variance in float64, from whichever of the two Gram matrices is smaller."""
    wide = len(centred) <= centred.shape[1]
    gram = (centred @ centred.T if wide else centred.T @ centred).double()
    values, vectors = torch.linalg.eigh(gram)
    values, vectors = values[-count:].flip(0), vectors[:, -count:].flip(1)
    kept = values > values[0] * 1e-6
    values, vectors = values[kept], vectors[:, kept]
    axes: Tensor = (centred.T @ (vectors / values.sqrt()).float()).double() if wide else vectors
    return axes
