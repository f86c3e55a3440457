r"""Calibration of a classifier's confidence: expected calibration error and negative log-likelihood.

With bins :math:`B_m` of equal width over the probability of the predicted class,

.. math:: \mathrm{ECE} = \sum_m \frac{|B_m|}{n} \, |\mathrm{accuracy}(B_m) - \mathrm{confidence}(B_m)| ,
   \qquad \mathrm{NLL} = -\frac1n \sum_i \log p_i(y_i) .

Source: C. Guo, G. Pleiss, Y. Sun, K. Weinberger, "On calibration of modern neural networks", ICML 2017, which uses 15
bins. The estimate is biased upwards for few images: a calibrated network has an ECE of about
:math:`\sum_m \sqrt{2 |B_m| v_m / \pi} / n`, with :math:`v_m` the variance of correctness in bin m.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int64
from numpy import ndarray
from torch import Tensor

#: bins of equal width; bin m holds confidences in ((m - 1) / 15, m / 15]
BINS = 15


@dataclass(frozen=True)
class Confidence:
    """A classifier's confidence on each image, in the order of the split.

    Attributes:
        predicted: probability of the predicted class.
        nll: negative logarithm of the probability of the true class, in nats.
    """

    predicted: Float32[ndarray, "n"]
    nll: Float32[ndarray, "n"]

    @classmethod
    def of_logits(cls, logits: Float[Tensor, "n k"], labels: Int64[Tensor, "n"]) -> "Confidence":
        """The confidences of logits, by softmax in 32 bits; infinite logits give a nan.

        >>> found = Confidence.of_logits(torch.tensor([[0.0, 0.0], [0.0, 100.0]]), torch.tensor([0, 1]))
        >>> found.predicted.tolist(), [f"{nll:.2f}" for nll in abs(found.nll)]
        ([0.5, 1.0], ['0.69', '0.00'])
        """
        log_p = torch.log_softmax(logits.detach().float(), 1)
        of_label = log_p.gather(1, labels[:, None].to(log_p.device))[:, 0]
        return cls(log_p.amax(1).exp().cpu().numpy(), (-of_label).cpu().numpy())

    @classmethod
    def joined(cls, parts: "Sequence[Confidence]") -> "Confidence":
        """The confidences of consecutive batches."""
        return cls(np.concatenate([p.predicted for p in parts]), np.concatenate([p.nll for p in parts]))


def expected_calibration_error(confidence: Float[ndarray, "n"], right: Bool[ndarray, "n"], bins: int = BINS) -> float:
    """The expected calibration error, in [0, 1].

    Args:
        confidence: probability of the predicted class, in [0, 1].
        right: whether the prediction is correct.
        bins: number of bins of equal width.

    Raises:
        ValueError: there are no images, the lengths differ, a probability is outside [0, 1], or ``bins`` is below 1.

    >>> expected_calibration_error(np.array([0.9, 0.9, 0.9, 0.9]), np.array([True, True, True, False]))
    0.15000000000000002
    """
    if len(confidence) == 0 or confidence.shape != right.shape or bins < 1:
        raise ValueError(
            f"need one confidence per image ({len(right)}), and at least one image and bin; got {confidence.shape}"
        )
    if not ((confidence >= 0) & (confidence <= 1 + 1e-6)).all():
        raise ValueError("confidences must be in [0, 1]")
    of_bin = np.clip(np.ceil(np.asarray(confidence, np.float64) * bins) - 1, 0, bins - 1).astype(np.int64)
    gaps = np.bincount(of_bin, np.asarray(right, np.float64) - np.asarray(confidence, np.float64), bins)
    return float(np.abs(gaps).sum() / len(right))


def trust(
    condition: str, confidence: Float[ndarray, "n"], nll: Float[ndarray, "n"], right: Bool[ndarray, "n"]
) -> dict[str, float]:
    """``test/ece/<condition>`` and the mean ``test/nll/<condition>`` as metrics; none for logits that were not finite.

    >>> trust("clean", np.array([1.0, 1.0]), np.array([0.0, 2.0]), np.array([True, False]))
    {'test/ece/clean': 0.5, 'test/nll/clean': 1.0}
    """
    if not (np.isfinite(confidence).all() and np.isfinite(nll).all()):
        return {}
    ece = expected_calibration_error(np.asarray(confidence), np.asarray(right))
    return {f"test/ece/{condition}": ece, f"test/nll/{condition}": float(np.mean(nll, dtype=np.float64))}
