"""Worlds of one dimension where Bayes' rule can be worked out on a grid, as an oracle for the filter."""

import math
from dataclasses import dataclass

import torch

from sextant.localization.observation.evidence import Evidence


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


class Told(Evidence):
    """Evidence from one function of poses ``(..., 3)`` for each run."""

    def __init__(self, functions, map_poses):
        self.functions, self.map_poses = functions, map_poses

    def log_likelihood(self, poses):
        return torch.stack([of(run) for of, run in zip(self.functions, poses, strict=True)])

    def over_map(self):
        return torch.stack([of(self.map_poses) for of in self.functions])


def peaks(centres, width, axis, period=None, floor=0.02):
    """Several places that look alike: a log-likelihood with a peak of its height at each centre."""

    def log_likelihood(poses):
        value = torch.full(poses.shape[:-1], floor, dtype=torch.float64)
        for centre, height in centres:
            apart = poses[..., axis] - centre
            if period:
                apart = torch.remainder(apart + period / 2, period) - period / 2
            value = value + height * torch.exp(-0.5 * (apart / width) ** 2)
        return value.log()

    return log_likelihood


@dataclass
class GridWorld:
    """A line (axis 0, heading 0) or a circle (axis 2, a robot that turns on the spot), and densities on its grid."""

    axis: int
    low: float
    high: float
    step: float
    map_poses: torch.Tensor
    jitter: float
    noise: float

    @property
    def period(self):
        return 2 * math.pi if self.axis == 2 else None

    @property
    def cells(self):
        count = round((self.high - self.low) / self.step)
        return self.low + (torch.arange(count, dtype=torch.float64) + 0.5) * self.step

    def poses(self):
        poses = torch.zeros(len(self.cells), 3, dtype=torch.float64)
        poses[:, self.axis] = self.cells
        return poses

    def gaussian(self, centre, sigma):
        """Mass in each cell, of one Gaussian for each centre."""
        apart = self.cells - centre[:, None]
        if self.period:
            apart = torch.remainder(apart + self.period / 2, self.period) - self.period / 2
        mass = torch.exp(-0.5 * (apart / sigma) ** 2)
        return mass / mass.sum(1, keepdim=True)

    def prior(self):
        return self.gaussian(self.map_poses[:, self.axis], self.jitter).mean(0)

    def predict(self, mass, motion):
        return mass @ self.gaussian(self.cells + motion, self.noise)

    def restarted(self, mass, hazard):
        return (1 - hazard) * mass + hazard * self.prior()

    def update(self, mass, log_likelihood):
        """The posterior and the log of the evidence."""
        joint = mass * log_likelihood(self.poses()).exp()
        return joint / joint.sum(), joint.sum().log()

    def total_variation(self, mass, belief, run, together):
        """Half the summed difference to the particles' histogram over boxes of ``together`` cells."""
        index = ((belief.poses[run, :, self.axis] - self.low) / self.step).floor().long()
        index = index % len(mass) if self.period else index.clamp(0, len(mass) - 1)
        histogram = torch.zeros_like(mass).index_add_(0, index, belief.weights[run])
        difference = (histogram - mass).reshape(-1, together).sum(1)
        return 0.5 * float(difference.abs().sum())


def line():
    """60 images a metre apart."""
    poses = torch.zeros(60, 3, dtype=torch.float64)
    poses[:, 0] = torch.arange(60)
    return GridWorld(0, -20.0, 100.0, 0.1, poses, jitter=0.5, noise=0.3)


def circle():
    """36 images taken at one place, turning."""
    poses = torch.zeros(36, 3, dtype=torch.float64)
    poses[:, 2] = torch.arange(36) * (2 * math.pi / 36) - math.pi
    return GridWorld(2, -math.pi, math.pi, 2 * math.pi / 720, poses, jitter=0.09, noise=0.06)
