r"""Distance of a picture's appearance from a set of pictures, by sixteen image statistics.

For each third of a picture from top to bottom, these are the log of the mean gradient and the mean brightness,
saturation and warmth (red minus blue). For the whole picture, they are the contrast, the logs of the median and the
mean Laplacian (grain and detail), and the log ratio of horizontal to vertical gradients. With these as :math:`x`, and
their mean :math:`\mu` and covariance :math:`\Sigma` over the set, the distance is Mahalanobis's

.. math:: d(x) = \sqrt{(x - \mu)^\top \Sigma_\lambda^{-1} (x - \mu)},

where each number is divided by its standard deviation, and :math:`\Sigma_\lambda` is :math:`\Sigma` shrunk by a tenth
towards a multiple of the identity, as crops of a few dozen scenes do not determine it. The distance of a new picture is
compared with those of the set's own pictures, each measured to all scenes but its own.

It detects pages of text, noise and unfamiliar kinds of scenes, but not every failure of a network: an ordinary-looking
photo may be taken with a lens outside the training distribution.

Sources: P. C. Mahalanobis, "On the generalised distance in statistics", 1936; K. Lee et al., "A simple unified
framework for detecting out-of-distribution samples and adversarial attacks", NeurIPS 2018, who use it on features of a
network; O. Ledoit, M. Wolf, "A well-conditioned estimator for large-dimensional covariance matrices", 2004, for the
form of the shrinkage.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

#: numbers given by :func:`picture_looks`
NUMBERS = 16
BANDS = 3
SHRINKAGE = 0.1
#: floor of logarithms and standard deviations: a uniform grey picture has no gradient
SMALLEST = 1e-3


def picture_looks(images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 16"]:
    """The sixteen numbers of pictures with values in [0, 1], at least six pixels high.

    >>> picture_looks(torch.rand(2, 3, 24, 32)).shape
    torch.Size([2, 16])
    """
    grey = images.mean(1)
    along, down = grey.diff(dim=2).abs()[:, :-1], grey.diff(dim=1).abs()[:, :, :-1]
    around = grey[:, :-2, 1:-1] + grey[:, 2:, 1:-1] + grey[:, 1:-1, :-2] + grey[:, 1:-1, 2:]
    detail = (4 * grey[:, 1:-1, 1:-1] - around).abs().flatten(1)
    maps = (grey, images.amax(1) - images.amin(1), images[:, 0] - images[:, 2])
    bands = [band.mean((1, 2)) for each in maps for band in each.tensor_split(BANDS, 1)]
    edges = [_log(band.mean((1, 2))) for band in (along + down).tensor_split(BANDS, 1)]
    whole = [
        grey.flatten(1).std(1),
        _log(_lower_median(detail)),
        _log(detail.mean(1)),
        _log(along.mean((1, 2))) - _log(down.mean((1, 2))),
    ]
    return torch.stack([*edges, *bands, *whole], 1)


def _lower_median(values: Float[Tensor, "b n"]) -> Float[Tensor, "b"]:
    """Lower median; by sorting on a GPU, as PyTorch's median of rows is refused there in deterministic mode."""
    if values.is_cpu:
        return values.median(1).values
    return values.sort(1).values[:, (values.shape[1] - 1) // 2]


@dataclass(frozen=True)
class LooksSpread:
    """Mean and spread of a set of pictures in the sixteen numbers.

    Attributes:
        mean: mean of the set.
        whitening: maps a difference from the mean to a vector whose length is the distance.

    Example:
        >>> noise = torch.rand(40, 3, 24, 32, generator=torch.Generator().manual_seed(0))
        >>> spread = LooksSpread.fit(picture_looks(noise))
        >>> noise[0] = 0.5  # grey
        >>> spread.distance(picture_looks(noise)).argmax()
        tensor(0)
    """

    mean: Float[Tensor, "16"]
    whitening: Float[Tensor, "16 16"]

    @classmethod
    def fit(cls, looks: Float[Tensor, "n 16"]) -> "LooksSpread":
        """The spread of a set of pictures.

        Raises:
            ValueError: there are fewer than two of them.
        """
        if len(looks) < 2:
            raise ValueError(f"looks has {len(looks)} pictures; the spread of a set needs at least 2")
        scale = looks.std(0).clamp(min=SMALLEST)
        mean, covariance = looks.mean(0), (looks / scale).T.cov()
        even = covariance.diagonal().mean() * torch.eye(looks.shape[1], dtype=looks.dtype, device=looks.device)
        shrunk = (1 - SHRINKAGE) * covariance + SHRINKAGE * even
        factor = torch.linalg.cholesky(shrunk + SMALLEST**2 * torch.eye(len(shrunk)).to(shrunk))
        return cls(mean, torch.linalg.inv(factor) / scale)

    def distance(self, looks: Float[Tensor, "b 16"]) -> Float[Tensor, "b"]:
        """Distances of pictures from the set."""
        distance: Tensor = ((looks - self.mean) @ self.whitening.T).norm(dim=1)
        return distance


def own_distances(looks: Float[Tensor, "n 16"], scenes: Int64[Tensor, "n"]) -> Float[Tensor, "n"]:
    """Distance of each picture of a set from those of all other scenes; infinite if there is no other scene.

    >>> pictures = torch.rand(40, 3, 24, 32, generator=torch.Generator().manual_seed(0))
    >>> pictures[:2] /= 2  # the first scene is darker
    >>> distances = own_distances(picture_looks(pictures), torch.arange(40) // 2)
    >>> bool(distances[:2].min() > distances[2:].max())
    True
    """
    distances = torch.full_like(looks[:, 0], torch.inf)
    for scene in scenes.unique():
        own = scenes == scene
        if int((~own).sum()) > 1:
            distances[own] = LooksSpread.fit(looks[~own]).distance(looks[own])
    return distances


def _log(values: Tensor) -> Tensor:
    return (values + SMALLEST).log()
