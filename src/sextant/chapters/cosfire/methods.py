"""Methods of classifying an image from the same examples: by filters, and those they are compared with."""

from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.baselines.linear_svm import LinearSVM, Scaling
from sextant.chapters.cosfire.config import RecognitionMethod

Method = Literal[RecognitionMethod, "cosfire_tuned", "layer_tuned"]
#: descriptions for tables
METHODS: dict[Method, str] = {
    "cosfire_svm": "maxima of COSFIRE filters, linear SVM",
    "tiled_svm": "maxima of COSFIRE filters in each tile of the image, linear SVM",
    "strongest_filter": "class of the filter whose response is largest relative to that to its own prototype",
    "full_svm": "whole feature map, linear SVM (the paper's baseline)",
    "pooled_svm": "feature map averaged over places, linear SVM",
    "nearest": "nearest example (of 10,000 at most) by the cosine of whole feature maps",
    "nearest_short": "the same with principal components of the maps, as many as place descriptors have dimensions",
    "network": "the network itself",
    "descriptor": "nearest example (of 10,000 at most) by the cosine of place descriptors",
    "cosfire_tuned": "log-maxima of COSFIRE filters, linear layer; both fine-tuned, starting from the SVM",
    "layer_tuned": "the same with only the layer fine-tuned: the control",
}
#: what a method uses of an image
Representation = Literal["maxima", "tiled", "tuned", "full", "pooled", "logits", "descriptor"]
REPRESENTATIONS: dict[Method, Representation] = {
    "cosfire_svm": "maxima",
    "tiled_svm": "tiled",
    "strongest_filter": "maxima",
    "full_svm": "full",
    "pooled_svm": "pooled",
    "nearest": "full",
    "nearest_short": "full",
    "network": "logits",
    "descriptor": "descriptor",
    "cosfire_tuned": "tuned",
    "layer_tuned": "maxima",
}
#: methods that are an SVM
SVMS: tuple[Method, ...] = ("cosfire_svm", "tiled_svm", "full_svm", "pooled_svm")
#: SVMs that use the filters' maxima
OF_MAXIMA: tuple[Method, ...] = ("cosfire_svm", "tiled_svm")
#: methods of fine-tuning
TUNED: tuple[Method, ...] = ("cosfire_tuned", "layer_tuned")
#: methods that compare with the examples themselves
OF_EXAMPLES: tuple[Method, ...] = ("nearest", "nearest_short", "descriptor")
#: methods that need a network
OF_NETWORK: tuple[Method, ...] = ("full_svm", "pooled_svm", "nearest", "nearest_short", "network")
#: most examples among which the nearest is searched
NEAREST_AMONG = 10_000


def svm_of(
    examples: tuple[Float[Tensor, "n d"], Int64[Tensor, "n"]],
    tuning: tuple[Float[Tensor, "m d"], Int64[Tensor, "m"]],
    count: int,
    c_values: tuple[float, ...],
    scalings: tuple[Scaling, ...],
    choose_among: int,
    seed: int,
) -> LinearSVM:
    """Fit an SVM to the examples; tuning images choose C and scaling, with at most ``choose_among`` examples."""
    features, labels = (
        values.double().numpy() if values.is_floating_point() else values.numpy() for values in examples
    )
    held = tuple(values.double().numpy() if values.is_floating_point() else values.numpy() for values in tuning)
    if len(c_values) * len(scalings) == 1:
        return LinearSVM.fit(features, labels, count, c_values[0], seed, scalings[0])
    rows = np.random.default_rng(seed).permutation(len(labels))[:choose_among]
    few = LinearSVM.choose((features[rows], labels[rows]), held, count, c_values, seed, scalings)  # type: ignore[arg-type]
    return few if len(rows) == len(labels) else LinearSVM.fit(features, labels, count, few.c, seed, few.scaling)


def strongest_filter(
    maxima: Float[Tensor, "n f"], own: Float[Tensor, "f"], labels: Int64[Tensor, "f"], count: int
) -> Float[Tensor, "n k"]:
    """For each class, the largest response of its filters, each as a share of the response to its own prototype."""
    return _best_of_class(maxima / own.clamp(min=torch.finfo(own.dtype).tiny), labels, count)


def nearest_example(
    images: Float[Tensor, "n d"], examples: Float[Tensor, "m d"], labels: Int64[Tensor, "m"], count: int
) -> Float[Tensor, "n k"]:
    """For each class, the largest cosine similarity to one of its examples."""
    known = F.normalize(examples, dim=1)
    found = [_best_of_class(F.normalize(batch, dim=1) @ known.T, labels, count) for batch in images.split(1024)]
    return torch.cat(found)


def principal_components(
    images: Float[Tensor, "n d"], examples: Float[Tensor, "m d"], count: int
) -> tuple[Float[Tensor, "n c"], Float[Tensor, "m c"]]:
    """The first ``count`` principal components of the examples, at most one fewer than there are, in both.

    >>> line = torch.tensor([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]])  # all that differs is the place along it
    >>> [found.abs().tolist() for found in principal_components(line[:1], line, 1)]
    [[[5.0]], [[5.0], [0.0], [5.0]]]
    """
    mean = examples.mean(0)
    basis = torch.linalg.svd(examples - mean, full_matrices=False)[2][: min(count, len(examples) - 1)].T
    return (images - mean) @ basis, (examples - mean) @ basis


def _best_of_class(scores: Float[Tensor, "n m"], labels: Int64[Tensor, "m"], count: int) -> Float[Tensor, "n k"]:
    """The largest of the columns of each label; -inf if there is none."""
    best = scores.new_full((len(scores), count), -torch.inf)
    return best.scatter_reduce(1, labels.expand(len(scores), -1), scores, "amax")
