r"""Fine-tuning of configured filters together with the linear layer that classifies by their responses.

.. math:: \ell(I) = W\,\frac{\log\max_x R(I, x) - \mu}{s} + b,

with R the responses of the filters and μ, s the mean and the deviation of the log-maxima of the examples before
training; W and b start from a support vector machine. W, b and the parts of the filters are trained by cross-entropy:
the weights of geometric means, the directions of a network's vectors and, if shifts are bilinear, places. A control
trains only W and b.
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
from sextant.reporter import Advance

#: images per step
BATCH = 32


@dataclass(frozen=True)
class FineTuning:
    """How filters are fine-tuned.

    Attributes:
        epochs: passes over the examples; 0 leaves the filters as configured.
        lr: learning rate of Adam.
    """

    epochs: int = 0
    lr: float = 0.001


@dataclass(frozen=True)
class LinearLayer:
    """Scores ``x @ weights.T + bias``; classes without an example have a bias of -inf."""

    weights: Float64[Tensor, "k d"]
    bias: Float64[Tensor, "k"]

    def scores(self, features: Float[Tensor, "n d"]) -> Float64[Tensor, "n k"]:
        """Scores of each class, on the CPU."""
        return features.double().cpu() @ self.weights.cpu().T + self.bias.cpu()


@dataclass(frozen=True)
class TunedLayer:
    """The result of fine-tuning a layer.

    Attributes:
        layer: over log-maxima.
        losses: mean cross-entropy during each epoch of training.
    """

    layer: LinearLayer
    losses: list[float]


@dataclass(frozen=True)
class Tuned(TunedLayer):
    """The result of fine-tuning filters and layer; the layer is over the log-maxima of these filters.

    Attributes:
        filters: the trained copy.
    """

    filters: Cosfire


def fine_tune(
    filters: Cosfire,
    copy: Callable[[], Cosfire],
    start: LinearLayer,
    maxima: Float[Tensor, "n f"],
    images: UInt8[Tensor, "n c h w"],
    labels: Int64[Tensor, "n"],
    settings: FineTuning,
    generator: torch.Generator,
    show: Advance = lambda done, total: None,
) -> Tuned:
    """Train a copy of ``filters`` and of the layer on the examples; ``filters`` are left unchanged.

    Args:
        filters: configured.
        copy: makes filters with the same options, which may share the network of their bank.
        start: fitted to the log-maxima of the examples.
        maxima: of the examples, from the filters before training.
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
    head = _Head(start, maxima).to(device)

    def seen(rows: Tensor) -> Tensor:
        return log_maxima(trained.maxima(images[rows].to(device).float() / 255))

    losses = _descend(head, _parts(trained), seen, labels, settings, generator, show)
    return Tuned(head.layer(), losses, trained)


def tune_layer(
    start: LinearLayer,
    maxima: Float[Tensor, "n f"],
    labels: Int64[Tensor, "n"],
    settings: FineTuning,
    generator: torch.Generator,
) -> TunedLayer:
    """Train only the layer, with the same settings: the control for what :func:`fine_tune` gains by the filters.

    Args:
        start: fitted to the log-maxima of the examples.
        maxima, labels: of the examples.
        settings: how long and how fast.
        generator: of the order of the examples.

    Raises:
        LossNotFiniteError: a loss is not a number.
    """
    head = _Head(start, maxima)
    losses = _descend(head, [], lambda rows: log_maxima(maxima[rows]), labels, settings, generator)
    return TunedLayer(head.layer(), losses)


def log_maxima(maxima: Float[Tensor, "n f"]) -> Float[Tensor, "n f"]:
    """Logarithms of maxima, clamped below at a thousandth of the largest possible value."""
    return maxima.clamp(min=1e-3).log()


def _descend(
    head: "_Head",
    parts: list[nn.Parameter],
    seen: Callable[[Int64[Tensor, "b"]], Float[Tensor, "b f"]],
    labels: Int64[Tensor, "n"],
    settings: FineTuning,
    generator: torch.Generator,
    show: Advance = lambda done, total: None,
) -> list[float]:
    """Run Adam over ``head`` and ``parts`` and return the mean loss by epoch; ``seen`` gives log-maxima by row."""
    number = head.number(labels)
    optimizer = torch.optim.Adam([*parts, *head.parameters()], lr=settings.lr)
    losses, count = [], len(labels)
    for epoch in range(settings.epochs):
        batches, summed = torch.randperm(count, generator=generator).split(BATCH), 0.0
        for step, rows in enumerate(batches):
            with torch.enable_grad():
                loss = F.cross_entropy(head(seen(rows)), number[rows.to(number.device)])
                optimizer.zero_grad()
                loss.backward()
            if not math.isfinite(value := float(loss.detach())):
                raise LossNotFiniteError(
                    f"the loss of fine-tuning became {value} at step {epoch * len(batches) + step}",
                    "Lower task.fine_tune.lr.",
                )
            optimizer.step()
            summed += value * len(rows)
            show(epoch * count + min((step + 1) * BATCH, count), settings.epochs * count)
        losses.append(summed / count)
    return losses


class _Head(nn.Module):
    """The layer over scaled log-maxima, for classes with an example: a bias of -inf would make gradients nan."""

    def __init__(self, start: LinearLayer, maxima: Float[Tensor, "n f"]):
        super().__init__()
        values = log_maxima(maxima).double().cpu()
        deviation = values.std(0, correction=0)
        # dividing by its own deviation would blow up a filter that responds equally to all images
        least = 1e-3 * float(deviation.max())
        self.mean, self.deviation = values.mean(0), deviation.clamp(min=least if least > 0 else 1.0)
        self.present = start.bias.isfinite()
        weights = start.weights[self.present]
        self.linear = nn.Linear(maxima.shape[1], len(weights))
        with torch.no_grad():
            self.linear.weight.copy_(weights * self.deviation)
            self.linear.bias.copy_(start.bias[self.present] + weights @ self.mean)

    def forward(self, features: Float[Tensor, "b f"]) -> Float[Tensor, "b k"]:
        return self.linear((features - self.mean.to(features)) / self.deviation.to(features))  # type: ignore[no-any-return]

    def number(self, labels: Int64[Tensor, "n"]) -> Int64[Tensor, "n"]:
        """The row of the layer for each label."""
        return (self.present.cumsum(0) - 1)[labels].to(self.linear.weight.device)

    def layer(self) -> LinearLayer:
        """The layer over unscaled log-maxima, for all classes."""
        weights = self.linear.weight.detach().double().cpu() / self.deviation
        bias = self.linear.bias.detach().double().cpu() - weights @ self.mean
        found = LinearLayer(
            torch.zeros(len(self.present), weights.shape[1], dtype=torch.float64),
            torch.full((len(self.present),), -torch.inf, dtype=torch.float64),
        )
        found.weights[self.present], found.bias[self.present] = weights, bias
        return found


def _parts(filters: Cosfire) -> list[nn.Parameter]:
    """The trainable parameters, without the network of the bank."""
    return [parameter for parameter in filters.parameters(recurse=False) if parameter.requires_grad]
