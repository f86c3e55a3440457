"""Observation models: predictions of the image descriptor at any pose, learned from images at known poses."""

import inspect
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Self

import torch
from jaxtyping import Float32, Float64
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.evidence import Evidence, check_runs
from sextant.localization.pose_kernel import PoseKernel
from sextant.shapes import check_shape


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


#: Poses whose means are held at a time: 8 MiB for 128 values in float64.
BLOCK = 8192


class ObservationModel(ABC):
    """A Gaussian for the descriptor at any pose, with one variance for all its dimensions.

    A subclass keeps the arguments of its constructor as attributes of the same names, so that a saved model can be
    rebuilt. It is fitted in :meth:`fit`, after which ``map`` and ``kernel`` are set.
    """

    map: DescriptorMap
    kernel: PoseKernel
    #: predictions at the map's own poses, means in float32 and variances; computed when first needed
    _over_map: tuple[Tensor, Tensor] | None = None

    def fit(self, map: DescriptorMap, kernel: PoseKernel) -> Self:
        """Fit the model to a map, replacing any earlier fit.

        Raises:
            UserError: the model cannot be fitted to this map or kernel.
        """
        self.map, self.kernel, self._over_map = map, kernel, None
        try:
            self._fit()
        except ArgumentError as error:  # an argument, such as ``self.neighbours``, does not suit the map
            error.of = type(self).__name__
            raise
        return self

    @abstractmethod
    def _fit(self) -> None:
        """Compute what predictions need from ``map`` and ``kernel``."""

    @abstractmethod
    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """The Gaussian of the descriptor at each pose."""

    @abstractmethod
    def state(self) -> dict[str, Tensor]:
        """What was computed from the map, as contiguous tensors by name; :meth:`load_state` restores it."""

    def load_state(self, map: DescriptorMap, kernel: PoseKernel, state: dict[str, Tensor]) -> Self:
        """Restore a fitted model from its ``state``; the tensors are not copied and may be mapped files.

        Raises:
            ValueError: the state is not one of this class with these arguments.
        """
        self.map, self.kernel, self._over_map = map, kernel, None
        self._load(state)
        return self

    @abstractmethod
    def _load(self, state: dict[str, Tensor]) -> None:
        """Restore the result of :meth:`state`; ``map`` and ``kernel`` are set."""

    def arguments(self) -> dict[str, Any]:
        """The constructor's arguments by name."""
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}

    def residuals(self, descriptors: Float32[Tensor, "r d"], poses: Float64[Tensor, "r p 3"]) -> Residuals:
        """How far each run's descriptor is from the mean at its poses, without holding all means at once.

        Raises:
            ArgumentError: the poses are those of more or fewer runs than there are descriptors.
        """
        check_runs(poses, len(descriptors))
        runs, particles, _ = poses.shape
        owner = torch.arange(runs, device=poses.device).repeat_interleave(particles)
        squared, variance = [], []
        for some, whose in zip(poses.reshape(-1, 3).split(BLOCK), owner.split(BLOCK), strict=True):
            predicted = self.predict(some)
            squared.append((descriptors[whose].double() - predicted.mean).square().sum(dim=1))
            variance.append(predicted.variance)
        return Residuals(torch.cat(squared).view(runs, particles), torch.cat(variance).view(runs, particles))

    def residuals_over_map(self, descriptors: Float32[Tensor, "r d"]) -> Residuals:
        """How far each run's descriptor is from the mean at the pose of every map image."""
        if self._over_map is None:
            predicted = [self.predict(some) for some in self.map.poses.split(BLOCK)]
            means = torch.cat([part.mean.float() for part in predicted])
            self._over_map = means, torch.cat([part.variance for part in predicted])
        means, variance = self._over_map
        squared = torch.cdist(descriptors, means, compute_mode="donot_use_mm_for_euclid_dist").double().square()
        return Residuals(squared, variance.expand_as(squared))

    def observe(self, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood) -> Evidence:
        """The evidence of the descriptors, one per run, about each run's pose. A descriptor with nan gives nan.

        Raises:
            UserError: the descriptors are not one row for each run, or have a different dimension from the map's.
        """
        self.check_dimension(descriptors)
        return GaussianEvidence(self, descriptors, likelihood)

    def check_dimension(self, descriptors: Tensor) -> None:
        """Raise a UserError unless the descriptors are rows of as many values as the map's."""
        check_shape("descriptors", descriptors, "runs", "values")
        if descriptors.shape[1] != self.map.dimension:
            raise UserError(
                f"descriptors of {descriptors.shape[1]} values cannot be compared with the map's, which have "
                f"{self.map.dimension}",
                "Describe the images with the descriptor that the map was built with, or rebuild the map.",
            )


class GaussianEvidence(Evidence):
    """Evidence from the predicted mean and variance at each requested pose."""

    def __init__(self, model: ObservationModel, descriptors: Float32[Tensor, "r d"], likelihood: Likelihood):
        self.model, self.descriptors, self.likelihood = model, descriptors, likelihood

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`Evidence`."""
        return self._log_prob(self.model.residuals(self.descriptors, poses))

    def over_map(self) -> Float64[Tensor, "r n"]:
        """See :class:`Evidence`."""
        return self._log_prob(self.model.residuals_over_map(self.descriptors))

    def _log_prob(self, residuals: Residuals) -> Tensor:
        return self.likelihood.log_prob(residuals.squared, residuals.variance, self.model.map.dimension)


def stored(state: dict[str, Tensor], name: str, shape: tuple[int, ...], dtype: torch.dtype = torch.float64) -> Tensor:
    """The tensor of that name.

    Raises:
        ValueError: it is missing, or has a different shape or type.
    """
    if name not in state:
        raise ValueError(f"the state has no {name}")
    tensor = state[name]
    if tuple(tensor.shape) != shape or tensor.dtype != dtype:
        raise ValueError(f"{name} is {tensor.dtype} {tuple(tensor.shape)}; need {dtype} {shape}")
    return tensor
