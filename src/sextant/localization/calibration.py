r"""Calibration of a descriptor likelihood on a traverse with known poses.

A Gaussian process fitted to a map predicts images in the map's own light, with little variance. In another season, and
with D = 128 outputs whose errors are correlated, :math:`\log p(z \mid x)` is far too sharp: on a real railway the
posterior over places is then worse than a uniform one. There are three remedies. Each is fitted to validation images z
at known poses, none of which is in the map:

- *whitening*: errors :math:`e = z - y` between a validation image and the map image nearest to it have the covariance
  :math:`S = (1 - \lambda) \overline{e e^\top} + \lambda \bar s I`. Before anything else, all descriptors are multiplied
  by :math:`\sqrt{\bar s}\, S^{-1/2}`, with :math:`\bar s = \operatorname{tr} S / D`;
- *appearance noise*: :math:`\sigma_a^2 = \max(0, \overline{\lVert z - \mu(x)\rVert^2} / D - \overline{s^2(x)})`, at the
  true poses x, is added to the variance everywhere;
- *tempering*: the log-likelihood is multiplied by the :math:`\beta` that minimizes the negative log-likelihood of the
  posterior over map images, ``1 / T`` of :func:`~sextant.evaluation.posterior.fit_temperature`.

Sources: P. Pfaff, C. Plagemann, W. Burgard, "Improved likelihood models for probabilistic localization based on range
scans", IROS 2007, on why the likelihoods of sensors with dependent errors must be smoothed; A. Jaenal et al., Sensors
21:2483, 2021, for appearance change as white noise.
"""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sextant.evaluation.positives import Positives
from sextant.evaluation.posterior import PlacePosterior, fit_temperature, place_posterior
from sextant.localization.likelihood import Likelihood

#: share of the mean variance in the covariance of errors, which is singular with fewer images than dimensions
SHRINKAGE = 0.2


def error_whitening(errors: Float[Tensor, "v d"], shrinkage: float = SHRINKAGE) -> Float[Tensor, "d d"]:
    r"""The symmetric whitening matrix ``√s̄ S^(-1/2)``, with S the shrunk covariance of the errors about zero.

    Raises:
        ValueError: there are no errors, all are zero, or the shrinkage is not in (0, 1].

    Example:
        >>> errors = torch.tensor([[2.0, 0.0], [-2.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        >>> errors.square().mean(0)
        tensor([2.0000, 0.5000])
        >>> (errors.double() @ error_whitening(errors, shrinkage=1e-9)).square().mean(0)  # the same sum, spread evenly
        tensor([1.2500, 1.2500], dtype=torch.float64)
        >>> error_whitening(errors, shrinkage=1.0).round(decimals=4) + 0.0  # treats all directions alike
        tensor([[1., 0.],
                [0., 1.]], dtype=torch.float64)
    """
    if not 0 < shrinkage <= 1:
        raise ValueError(f"shrinkage={shrinkage} must be in (0, 1]")
    rows = errors.double()
    covariance = rows.mT @ rows / max(len(rows), 1)
    mean = covariance.diagonal().mean()
    if not mean > 0:
        raise ValueError("there are no errors to whiten")
    shrunk = (1 - shrinkage) * covariance + shrinkage * mean * torch.eye(len(covariance), dtype=rows.dtype)
    values, vectors = torch.linalg.eigh(shrunk)
    return torch.mm(vectors * (mean / values).sqrt(), vectors.mT)


def appearance_noise(squared: Float[Tensor, " v"], variance: Float[Tensor, " v"], dimension: int) -> float:
    r"""The appearance noise :math:`\sigma_a^2`, from squared errors and predicted variances at the true poses.

    Example:
        >>> squared, variance = torch.tensor([2.0, 4.0]), torch.tensor([0.5, 0.5])
        >>> appearance_noise(squared, variance, dimension=2)  # 3 / 2 per dimension, 1 more than predicted
        1.0
        >>> appearance_noise(squared, 4 * variance, dimension=2)  # the predicted variance is large enough
        0.0
    """
    return max(0.0, float(squared.mean()) / dimension - float(variance.mean()))


def tempered(likelihood: Likelihood, scores: Float[Tensor, "v n"], positives: Positives) -> Likelihood:
    """The likelihood with the tempering that fits best, capped at 1.

    Args:
        likelihood: the likelihood whose ``tempering`` is replaced.
        scores: log-likelihoods of v validation images at the poses of n map images, without tempering.
        positives: map images at the place of each validation image.

    Raises:
        ValueError: no validation image has a positive, or all scores are equal.

    Example:
        >>> places = Positives.from_lists([[0], [0], [0], [1]], references=2)
        >>> scores = torch.tensor([[10.0, 0.0]]).repeat(4, 1)  # 10 nats for the first image, which is right in 3 of 4
        >>> f"{tempered(Likelihood(), scores, places).tempering:.2f}"  # 1.1 nats are enough: ln 3, which gives it 3/4
        '0.11'
    """
    return replace(likelihood, tempering=min(1.0, 1 / fit_temperature(_array(scores), positives)))


def posterior(scores: Float[Tensor, "v n"], positives: Positives, tempering: float) -> PlacePosterior:
    """The posterior over map images at a given tempering; see :mod:`sextant.evaluation.posterior`.

    Example:
        >>> place, scores = Positives.from_lists([[0]], references=2), torch.tensor([[3.0, 1.0]]).log()
        >>> likely = [posterior(scores, place, tempering).nll for tempering in (1.0, 1e-6)]
        >>> [f"{np.exp(-nll):.2f}" for nll in likely]  # 3/4 for the right one of two; with hardly a difference, 1/2
        ['0.75', '0.50']
    """
    return place_posterior(_array(scores), positives, 1 / tempering)


def _array(scores: Tensor) -> np.ndarray:
    # adding a constant to a row does not change its posterior; subtracting the maximum keeps float32 accurate
    return np.asarray((scores - scores.max(dim=1, keepdim=True).values).numpy(), np.float32)
