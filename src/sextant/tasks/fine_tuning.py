r"""Training configured filters on, together with the linear layer that tells classes by their answers.

.. math:: \ell(I) = W\,\frac{\log\max_x R(I, x) - \mu}{s} + b,

with R the responses of the filters and μ, s the mean and the deviation of the log-maxima of the examples before
training; W and b start from a support vector machine. What trains is W, b and the parts of the filters (weights of
geometric means; of a network's vectors their directions; places too where shifts are bilinear), by cross-entropy.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float64, Int64, UInt8
from torch import Tensor, nn

from sextant.errors import LossNotFiniteError
from sextant.layers.cosfire import Cosfire
from sextant.tasks.representations import Progress

#: images of a step
BATCH = 32


@dataclass(frozen=True)
class FineTuning:
    """How filters are trained on.

    Attributes:
        epochs: over the examples; 0 leaves the filters as they were configured.
        lr: of Adam.
    """

    epochs: int = 0
    lr: float = 0.001


@dataclass(frozen=True)
class LinearLayer:
    """Scores ``x @ weights.T + bias``; classes without an example have a bias of -inf."""

    weights: Float64[Tensor, "k d"]
    bias: Float64[Tensor, "k"]

    def scores(self, features: Float[Tensor, "n d"]) -> Float64[Tensor, "n k"]:
        """Of each class, on the processor."""
        return features.double().cpu() @ self.weights.cpu().T + self.bias.cpu()


@dataclass(frozen=True)
class Tuned:
    """What came of it.

    Attributes:
        filters: the copy that was trained.
        layer: over the log-maxima of these filters.
        losses: mean cross-entropy of each epoch, while it was trained.
    """

    filters: Cosfire
    layer: LinearLayer
    losses: list[float]


def fine_tune(
    filters: Cosfire,
    copy: Callable[[], Cosfire],
    start: LinearLayer,
    maxima: Float[Tensor, "n f"],
    images: UInt8[Tensor, "n c h w"],
    labels: Int64[Tensor, "n"],
    settings: FineTuning,
    generator: torch.Generator,
    show: Progress = lambda done, total: None,
) -> Tuned:
    """Train a copy of ``filters`` and of the layer on the examples; ``filters`` stay as they are.

    Args:
        filters: configured.
        copy: makes filters of the same options, which may share the network of their bank.
        start: fitted to the log-maxima of the examples.
        maxima: of the examples, as the filters answer before training.
        images, labels: the examples.
        settings: how long and how fast.
        generator: of the order of the examples.
        show: progress in images.

    Raises:
        LossNotFiniteError: a loss is not a number.
    """
    trained, device = copy(), filters.rho.device
    trained.load_state_dict(filters.state_dict())
    trained.to(device).train_parts()
    scaling = _Scaling.of(log_maxima(maxima))
    present = start.bias.isfinite()  # a bias of -inf would make gradients nan
    head = nn.Linear(maxima.shape[1], int(present.sum()), device=device)
    weights = start.weights[present] * scaling.deviation
    with torch.no_grad():
        head.weight.copy_(weights)
        head.bias.copy_(start.bias[present] + start.weights[present] @ scaling.mean)
    number = (present.cumsum(0) - 1)[labels].to(device)
    optimizer = torch.optim.Adam([*_parts(trained), *head.parameters()], lr=settings.lr)
    losses, total = [], settings.epochs * len(images)
    for epoch in range(settings.epochs):
        order, summed = torch.randperm(len(images), generator=generator), 0.0
        for step, rows in enumerate(order.split(BATCH)):
            with torch.enable_grad():
                found = log_maxima(trained.maxima(images[rows].to(device).float() / 255))
                loss = F.cross_entropy(head(scaling(found)), number[rows.to(device)])
                optimizer.zero_grad()
                loss.backward()
            if not math.isfinite(value := float(loss.detach())):
                raise LossNotFiniteError.at(step, value)
            optimizer.step()
            summed += value * len(rows)
            show(epoch * len(images) + min((step + 1) * BATCH, len(images)), total)
        losses.append(summed / len(images))
    shares = head.weight.detach().double().cpu() / scaling.deviation
    layer = LinearLayer(torch.zeros_like(start.weights), torch.full_like(start.bias, -torch.inf))
    layer.weights[present] = shares
    layer.bias[present] = head.bias.detach().double().cpu() - shares @ scaling.mean
    return Tuned(trained, layer, losses)


def log_maxima(maxima: Float[Tensor, "n f"]) -> Float[Tensor, "n f"]:
    """Logarithms of maxima, of which none counts as less than a thousandth of the strongest there can be."""
    return maxima.clamp(min=1e-3).log()


@dataclass(frozen=True)
class _Scaling:
    mean: Float64[Tensor, "f"]
    deviation: Float64[Tensor, "f"]

    @classmethod
    def of(cls, features: Float[Tensor, "n f"]) -> "_Scaling":
        values = features.double().cpu()
        deviation = values.std(0, correction=0)
        # a filter that answers alike to all would be blown up by its own deviation
        least = 1e-3 * float(deviation.max())
        return cls(values.mean(0), deviation.clamp(min=least if least > 0 else 1.0))

    def __call__(self, features: Tensor) -> Tensor:
        return (features - self.mean.to(features)) / self.deviation.to(features)


def _parts(filters: Cosfire) -> list[nn.Parameter]:
    """What trains, without the network of the bank."""
    return [parameter for parameter in filters.parameters(recurse=False) if parameter.requires_grad]
