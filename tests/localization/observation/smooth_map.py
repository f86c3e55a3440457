"""A small map of a smooth world: descriptors that are sums of waves over position and heading."""

import torch

from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.pose_kernel import PoseKernel

SIZE = torch.tensor([6.0, 4.0], dtype=torch.float64)
WAVES = 24
KERNEL = PoseKernel(spatial="rbf", length=(1.5, 1.2), heading_length=0.9, signal_variance=1.0, noise_variance=0.01)


def poses_in_room(count: int, seed: int = 0) -> torch.Tensor:
    """Uniform in a room of 6 by 4 metres and over all headings."""
    uniform = torch.rand(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return torch.cat([uniform[:, :2] * SIZE, (uniform[:, 2:] * 2 - 1) * torch.pi], dim=1)


def descriptors_at(poses: torch.Tensor, dimension: int, noise: float = 0.1, seed: int = 0) -> torch.Tensor:
    """What images at poses look like: a draw of (nearly) the process of ``KERNEL``, about a mean that is not 0."""
    generator = torch.Generator().manual_seed(1000 + seed)
    frequencies = torch.randn(4, WAVES * dimension, dtype=torch.float64, generator=generator)
    phases = 2 * torch.pi * torch.rand(WAVES * dimension, dtype=torch.float64, generator=generator)
    waves = torch.cos(KERNEL.features(poses) @ frequencies + phases).view(len(poses), dimension, WAVES)
    signal = waves.sum(dim=2) * (2 / WAVES) ** 0.5
    noisy = signal + noise * torch.randn(signal.shape, dtype=torch.float64, generator=generator)
    return (noisy + 0.5).float()


def smooth_map(count: int = 240, dimension: int = 6) -> DescriptorMap:
    poses = poses_in_room(count)
    return DescriptorMap.of(poses, descriptors_at(poses, dimension))
