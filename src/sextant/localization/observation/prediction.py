"""What a map predicts of an image."""

from dataclasses import dataclass

from jaxtyping import Float64
from torch import Tensor


@dataclass(frozen=True)
class Prediction:
    """A Gaussian for the descriptor of an image at each of n poses, with the same variance in all dimensions.

    Attributes:
        mean: mean of the descriptor.
        variance: variance of each of its dimensions about the mean, observation noise included.
    """

    mean: Float64[Tensor, "n d"]
    variance: Float64[Tensor, " n"]


@dataclass(frozen=True)
class Residuals:
    """How far observed descriptors are from the predicted ones, and how far they are expected to be.

    Attributes:
        squared: squared distance between descriptor and predicted mean.
        variance: predicted variance of one dimension, observation noise included.
    """

    squared: Float64[Tensor, "r p"]
    variance: Float64[Tensor, "r p"]
