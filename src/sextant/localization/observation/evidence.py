"""The evidence of one observation about the pose of each of several runs."""

from abc import ABC, abstractmethod
from collections.abc import Callable

from jaxtyping import Bool, Float64
from torch import Tensor

from sextant.errors import ArgumentError
from sextant.shapes import check_shape
from sextant.tables import counted


class Evidence(ABC):
    """Log-likelihoods of one observation in each of r runs, such as an image or a laser scan.

    Values are in nats and comparable between all poses of a run, whichever method they come from. Everything that does
    not depend on the poses is computed once, when the evidence is made.
    """

    @abstractmethod
    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """The log-likelihood of each run's observation at that run's poses.

        Raises:
            ArgumentError: the poses are those of more or fewer runs than there are observations.
        """

    @abstractmethod
    def over_map(self) -> Float64[Tensor, "r n"]:
        """The log-likelihood at the pose of every image of the map."""

    def restricted(self, to: "Callable[[Evidence], Evidence]") -> "Evidence":
        """This evidence as ``to`` changes it, or that part of it which depends on the map's images."""
        return to(self)


def check_runs(poses: Tensor, runs: int, observation: str = "descriptor") -> None:
    """Raise an ``ArgumentError`` unless poses are those of as many runs as there are observations.

    >>> import torch
    >>> check_runs(torch.zeros(2, 100, 3), runs=2)
    """
    check_shape("poses", poses, "runs", "particles", 3)
    if len(poses) != runs:
        raise ArgumentError(
            f"poses of {counted(len(poses), 'run')} for {counted(runs, observation)}",
            "Give the poses of each run, and one observation for each.",
        )


class EvidenceOfSome(Evidence):
    """Evidence of some of r runs: in the others all poses are equally likely, and nothing is computed.

    Args:
        evidence: evidence of the runs that have an observation.
        looked: which of the r runs these are.

    Example:
        >>> import torch
        >>> class AtTen(Evidence):  # the observation matches the place at 10 m
        ...     log_likelihood = lambda self, poses: -(poses[..., 0] - 10).square()
        ...     over_map = lambda self: self.log_likelihood(line[None])
        >>> line = torch.tensor([[7.0, 0.0, 0.0], [8.0, 0.0, 0.0], [9.0, 0.0, 0.0]], dtype=torch.float64)
        >>> EvidenceOfSome(AtTen(), torch.tensor([False, True])).log_likelihood(line.repeat(2, 1, 1)).tolist()
        [[0.0, 0.0, 0.0], [-9.0, -4.0, -1.0]]
    """

    def __init__(self, evidence: Evidence, looked: Bool[Tensor, "r"]):
        self.evidence, self.looked = evidence, looked

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        check_runs(poses, len(self.looked), "run")
        return self._of_all(self.evidence.log_likelihood(poses[self.looked]))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`."""
        return self._of_all(self.evidence.over_map())

    def _of_all(self, told: Tensor) -> Tensor:
        whole = told.new_zeros(len(self.looked), told.shape[1])
        whole[self.looked] = told
        return whole
