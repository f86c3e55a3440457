r"""Flip probability: how often a prediction changes while an image changes slightly.

On m sequences of n frames, with :math:`f(x_j^{(i)})` the class predicted for frame j of sequence i,

.. math:: FP = \frac{1}{m (n-1)} \sum_{i=1}^m \sum_{j=2}^n [f(x_j^{(i)}) \ne f(x_{j-1}^{(i)})].

Noise sequences do not evolve: each frame has its own noise, so every frame is compared with the first.

Source: D. Hendrycks, T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, section 4.2.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Integer
from numpy import ndarray

#: the ten perturbations of CIFAR-10-P and ImageNet-P that are averaged
BENCHMARK_PERTURBATIONS = (
    "gaussian_noise",
    "shot_noise",
    "motion_blur",
    "zoom_blur",
    "snow",
    "brightness",
    "translate",
    "rotate",
    "tilt",
    "scale",
)


def is_noise(perturbation: str) -> bool:
    """Whether frames of this perturbation are compared with the first one.

    >>> is_noise("shot_noise"), is_noise("tilt")
    (True, False)
    """
    return perturbation.endswith("noise")


def flip_probability(predictions: Integer[ndarray, "sequences frames"], *, against_first: bool, step: int = 1) -> float:
    """Share of frames whose predicted class differs from the previous frame's, or from the first one's.

    Args:
        predictions: predicted class by sequence and frame.
        against_first: compare with the first frame, as noise perturbations require (:func:`is_noise`).
        step: distance between compared frames, over all phases (the benchmark's harder variants); not used with
            ``against_first``.

    Raises:
        ValueError: there is no sequence, sequences have no two frames ``step`` apart, or ``step`` is not positive.

    >>> frames = np.array([[3, 3, 5, 5]])
    >>> round(flip_probability(frames, against_first=False), 2), round(flip_probability(frames, against_first=True), 2)
    (0.33, 0.67)
    """
    count, frames = predictions.shape
    if step < 1 or count == 0 or frames <= step:
        raise ValueError(f"need sequences of more than {step} frames and a step of at least 1; got {predictions.shape}")
    if against_first:
        return float(np.mean(predictions[:, 1:] != predictions[:, :1]))
    return float(np.mean(predictions[:, step:] != predictions[:, :-step]))


def mean_flip_probability(
    by_perturbation: Mapping[str, float], perturbations: Sequence[str] = BENCHMARK_PERTURBATIONS
) -> float:
    """Mean over ``perturbations``; ``ValueError`` names the missing ones.

    >>> mean_flip_probability({"tilt": 0.1, "scale": 0.3, "snow": 0.9}, ("tilt", "scale"))
    0.2
    """
    if missing := [name for name in perturbations if name not in by_perturbation]:
        raise ValueError(f"no flip probability for {', '.join(missing)}")
    return float(np.mean([by_perturbation[name] for name in perturbations]))
