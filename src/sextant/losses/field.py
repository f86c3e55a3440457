r"""The loss of a believed perspective field: the negative log-likelihood of Laplace distributions.

.. math:: L = \frac1n \sum_i \ln\sigma_{\varphi,i} + \frac{|\Delta\varphi_i|}{\sigma_{\varphi,i}}
          + \ln\sigma_{\upsilon,i} + \frac{|\Delta\upsilon_i|}{\sigma_{\upsilon,i}} ,

smallest where each expected error is the mean size of the actual ones.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.geometry.field_fit import BelievedField
from sextant.geometry.perspective_field import PerspectiveField, field_errors


def field_loss(believed: BelievedField, true: PerspectiveField, seen: Bool[Tensor, "b n"]) -> Float[Tensor, "b"]:
    """The loss of each picture, over the points that are seen.

    >>> true = PerspectiveField(torch.zeros(1, 4), torch.tensor([[0.0, -1.0]]).expand(1, 4, 2))
    >>> sure, unsure = (BelievedField(true, torch.full((1, 2, 4), x), torch.ones(1, 4)) for x in (-2.0, 0.0))
    >>> [field_loss(each, true, torch.ones(1, 4, dtype=torch.bool)).item() for each in (sure, unsure)]
    [-4.0, 0.0]
    """
    errors = field_errors(believed.field, true).abs()
    each = (believed.log_error + errors * torch.exp(-believed.log_error)).sum(-2)
    return (each * seen).sum(-1) / seen.sum(-1).clamp(min=1)
