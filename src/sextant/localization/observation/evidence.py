"""The evidence of one observation about the pose of each of several runs."""

from abc import ABC, abstractmethod

from jaxtyping import Float64
from torch import Tensor


class Evidence(ABC):
    """Log-likelihoods of one observation in each of r runs, such as an image or a laser scan.

    Values are in nats, and comparable between all poses of a run, whichever method they come from. What an observation
    costs once, whatever the number of poses, is computed when the evidence is made.
    """

    @abstractmethod
    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """The log-likelihood of each run's observation at poses of its own."""

    @abstractmethod
    def over_map(self) -> Float64[Tensor, "r n"]:
        """The log-likelihood at the pose of every image of the map."""
