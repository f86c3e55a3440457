"""Sensors that turn frames of a drive into evidence: a camera with a map of descriptors, or a laser with a grid."""

from abc import ABC, abstractmethod

import numpy as np
import torch
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from torch import Tensor

from sextant.localization.laser import BeamModel, LikelihoodField
from sextant.localization.likelihood import Likelihood
from sextant.localization.metric_pose import DrivePoses
from sextant.localization.observation.evidence import Evidence
from sextant.localization.observation.model import ObservationModel


class Observer(ABC):
    """A sensor on a drive through a map."""

    @abstractmethod
    def observe(self, frames: Int64[ndarray, " r"]) -> Evidence:
        """The sensor's evidence at one frame of the drive for each of r runs."""


class Camera(Observer):
    """A camera, whose images are represented by their descriptors.

    Args:
        model: observation model of the map.
        likelihood: likelihood of a descriptor given the model's prediction.
        descriptors: descriptors of all frames of the drive, of the same kind as the map's.
        located: poses of these frames by correspondences; None if there are none.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import ExactGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> model = ExactGP().fit(DescriptorMap.of(line, torch.eye(20)), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1))
        >>> back = Camera(model, Likelihood(), np.eye(20, dtype=np.float32)[::-1])  # a drive along the map, backwards
        >>> back.observe(np.array([0, 5])).over_map().argmax(1)  # one run at its first frame, one at its sixth
        tensor([19, 14])
    """

    def __init__(
        self,
        model: ObservationModel,
        likelihood: Likelihood,
        descriptors: Float32[ndarray, "n d"],
        located: DrivePoses | None = None,
    ):
        self.model, self.likelihood, self.descriptors, self.located = model, likelihood, descriptors, located

    def observe(self, frames: Int64[ndarray, " r"]) -> Evidence:
        """See :class:`Observer`."""
        return self.model.observe(self.images(frames), self.likelihood)

    def images(self, frames: Int64[ndarray, " r"]) -> Float32[Tensor, "r d"]:
        """The descriptors of frames."""
        return torch.from_numpy(np.ascontiguousarray(self.descriptors[frames]))


class Laser(Observer):
    """A laser scanner in an occupancy grid.

    Args:
        model: measurement model of a scan.
        scans: ranges in metres of all frames of the drive.
        map_poses: poses at which restarts begin.

    Example:
        >>> from sextant.worlds import LaserScanner, OccupancyGrid
        >>> grid = OccupancyGrid(np.array([[0, 0, 0, 0, 1]], np.uint8), 0.5, (0.0, -0.25))  # a wall from x = 2 to 2.5 m
        >>> poses = torch.tensor([[0.25, 0.0, 0.0], [1.25, 0.0, 0.0]], dtype=torch.float64)
        >>> scans = np.array([[1.0], [2.0]], np.float32)  # of two frames: the wall is one metre ahead, then two
        >>> back = Laser(LikelihoodField(grid, LaserScanner(beams=1, max_range_m=10.0)), scans, poses)
        >>> back.observe(np.array([0, 1])).over_map().argmax(1)  # one run at the first frame, one at the second
        tensor([1, 0])
    """

    def __init__(
        self,
        model: LikelihoodField | BeamModel,
        scans: Float32[ndarray, "n beams"],
        map_poses: Float64[Tensor, "m 3"],
    ):
        self.model, self.scans, self.map_poses = model, scans, map_poses

    def observe(self, frames: Int64[ndarray, " r"]) -> Evidence:
        """See :class:`Observer`."""
        scans = torch.from_numpy(np.asarray(self.scans[frames], np.float64))
        return self.model.observe(scans, self.map_poses)
