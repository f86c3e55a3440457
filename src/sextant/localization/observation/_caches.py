"""The caches of all neighbourhoods of a map, computed in blocks of bounded size."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int32, Int64
from numpy import ndarray
from torch import Tensor

from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation._factor import noisy_factor, noisy_variance
from sextant.localization.observation.model import stored
from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.pose_kernel import PoseKernel

#: Noise, as a share of the signal, below which whiteners are kept in float64: rounding would show in the variance.
LITTLE_NOISE = 1e-3
#: Float64 values that are held at a time in each of a handful of arrays: 8 MiB.
ENTRIES = 2**20


@dataclass(frozen=True)
class Caches:
    r"""Precomputed arrays of every image i of a map, with N its k nearest images and :math:`L L^T = K_{NN} + s_n^2 I`.

    In float32, :math:`L^{-1}` and the Gram matrix of the whitened descriptors :math:`L^{-1} Y_c` lose far less accuracy
    than :math:`(K_{NN} + s_n^2 I)^{-1}` and the Gram matrix of :math:`Y_c`: errors grow with the square root of the
    condition number. Both are packed lower triangles.

    Attributes:
        neighbours: N, rows of the map.
        whiteners: :math:`L^{-1}`; float32, or float64 if there is little noise.
        grams: :math:`L^{-1} Y_c Y_c^T L^{-T}`.
        weights: :math:`(K_{NN} + s_n^2 I)^{-1} k_N` at the image's own pose.
        variances: variances of an observation at the image's own pose.
        image_norms: :math:`\|y_i - m\|^2`.
        mean_norms: :math:`\|\mu(x_i) - m\|^2`.
    """

    neighbours: Int32[ndarray, "n k"]
    whiteners: Float[ndarray, "n t"]
    grams: Float32[ndarray, "n t"]
    weights: Float32[ndarray, "n k"]
    variances: Float64[ndarray, " n"]
    image_norms: Float64[ndarray, " n"]
    mean_norms: Float64[ndarray, " n"]

    @classmethod
    def build(
        cls,
        map: DescriptorMap,
        kernel: PoseKernel,
        neighbourhoods: Neighbourhoods,
        k: int,
    ) -> Self:
        """Compute the caches of a map, whose descriptors may be a mapped file larger than memory.

        Raises:
            UserError: a covariance is not positive definite.
        """
        n = len(map)
        arrays = {name: np.empty(shape, dtype) for name, (shape, dtype) in layout(n, k, kernel).items()}
        at_a_time = images_at_a_time(k, map.dimension)
        for start in range(0, n, at_a_time):
            rows = torch.arange(start, min(start + at_a_time, n))
            for name, values in prepared(map, kernel, neighbourhoods.of_images(rows, k).rows, rows).items():
                arrays[name][start : start + len(rows)] = values.numpy()
        return cls(**arrays)

    @classmethod
    def of_state(cls, state: dict[str, Tensor], n: int, k: int, kernel: PoseKernel) -> Self:
        """Restore the caches from the result of :meth:`state`.

        Raises:
            ValueError: an array is missing or of the wrong shape or type.
        """
        arrays = {}
        for name, (shape, dtype) in layout(n, k, kernel).items():
            arrays[name] = stored(state, name, shape, torch.from_numpy(np.empty(0, dtype)).dtype).numpy()
        neighbours = arrays["neighbours"]
        if neighbours.min() < 0 or neighbours.max() >= n:  # machine code would read past the end of the map
            raise ValueError(f"neighbours names rows outside of the map's {n}")
        return cls(**arrays)

    def state(self) -> dict[str, Tensor]:
        """The arrays by name, as tensors that share their memory."""
        return {field.name: torch.from_numpy(getattr(self, field.name)) for field in fields(self)}


def layout(n: int, k: int, kernel: PoseKernel) -> dict[str, tuple[tuple[int, ...], type[np.generic]]]:
    """Shape and type of each array of the caches of n images."""
    triangle = k * (k + 1) // 2
    little_noise = kernel.noise_variance < LITTLE_NOISE * kernel.signal_variance
    return {
        "neighbours": ((n, k), np.int32),
        "whiteners": ((n, triangle), np.float64 if little_noise else np.float32),
        "grams": ((n, triangle), np.float32),
        "weights": ((n, k), np.float32),
        "variances": ((n,), np.float64),
        "image_norms": ((n,), np.float64),
        "mean_norms": ((n,), np.float64),
    }


def images_at_a_time(k: int, dimension: int) -> int:
    """The number of neighbourhoods that are prepared together."""
    return max(1, ENTRIES // (k * max(k, dimension)))


def prepared(
    map: DescriptorMap, kernel: PoseKernel, neighbours: Int64[Tensor, "b k"], rows: Int64[Tensor, " b"]
) -> dict[str, Tensor]:
    """The cached arrays of some images of a map, whose neighbours are rows of the same map.

    Raises:
        UserError: a covariance is not positive definite.
    """
    k = neighbours.shape[1]
    near = map.poses[neighbours]  # (b, k, 3)
    factor = noisy_factor(kernel(near, near), kernel.noise_variance)
    whitener = torch.linalg.solve_triangular(factor, torch.eye(k, dtype=torch.float64).expand_as(factor), upper=False)
    whitened = whitener @ (map.descriptors[neighbours] - map.mean).double()  # (b, k, d)
    gram = whitened @ whitened.mT
    known = whitener @ kernel(near, map.poses[rows, None, :])  # (b, k, 1)
    i, j = torch.tril_indices(k, k)
    return {
        "neighbours": neighbours.int(),
        "whiteners": whitener[:, i, j],
        "grams": gram[:, i, j].float(),
        "weights": (whitener.mT @ known)[..., 0].float(),
        "variances": noisy_variance(kernel, known.square().sum(dim=(1, 2))),
        "image_norms": (map.descriptors[rows] - map.mean).double().square().sum(dim=1),
        "mean_norms": (known.mT @ gram @ known)[:, 0, 0],
    }
