r"""Poses interpolated between the most similar images of a map, without a filter.

With :math:`s_i` the cosine similarity of the query's and a map image's descriptors, both less the map's mean, and B
those of the K most similar images that agree on a place (:func:`~sextant.localization.estimate.estimate`), the pose is

.. math:: \hat x = \frac{\sum_{i \in B} w_i\, x_i}{\sum_{i \in B} w_i}, \qquad w_i = \max(s_i, \epsilon),

and likewise its heading, from wrapped differences. Without the agreement, one image of another place shifts the mean by
metres. Each image is used on its own; a step without an image moves the last pose by the odometry, if it is known. This
is the baseline for filters and continuous maps.

Source: A. Torii, J. Sivic, T. Pajdla, "Visual localization by linear combination of image descriptors", ICCV Workshops
2011, for poses between images; here the similarities themselves are the weights.
"""

import time

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import normalize

from sextant.geometry.planar import se2_compose
from sextant.localization.belief import Belief
from sextant.localization.estimate import estimate
from sextant.localization.localize import Track, Watch
from sextant.localization.observers import Camera
from sextant.shapes import check_shape

#: weight of an image no more similar than chance, so that some image always has weight
LEAST_WEIGHT = 1e-6


def interpolated(
    camera: Camera,
    frames: Int64[ndarray, "t r"],
    motion: Float64[ndarray, "t r 3"],
    seen: Bool[ndarray, "t r"],
    *,
    best: int,
    radius: float,
    watch: Watch | None = None,
) -> Track:
    """The interpolated poses of r runs, as the track of a filter whose particles are the ``best`` images.

    Args:
        camera: the camera, with the map's descriptors and those of the drive.
        frames, motion, seen, radius, watch: as for :func:`~sextant.localization.localize.localize`.
        best: K; all images of a smaller map.

    Raises:
        ArgumentError: there is not one motion, and one value of ``seen``, for each of the frames.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.likelihood import Likelihood
        >>> from sextant.localization.observation import ExactGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> model = ExactGP().fit(DescriptorMap.of(line, torch.eye(20)), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1))
        >>> between = np.eye(20, dtype=np.float32)[:-1] + np.eye(20, dtype=np.float32)[1:]  # half of each neighbour
        >>> frames, still = np.array([[4], [9]]), np.zeros((2, 1, 3))
        >>> drive = Camera(model, Likelihood(), between)
        >>> interpolated(drive, frames, still, frames > 0, best=2, radius=1.0).pose[:, 0, 0]
        array([4.5, 9.5])
    """
    check_shape("motion", motion, *frames.shape, 3)
    check_shape("seen", seen, *frames.shape)
    known = camera.model.map
    count, mean = min(best, len(known)), known.mean.double()
    among = normalize(known.descriptors.double() - mean, dim=1)
    start = known.poses[torch.linspace(0, len(known) - 1, count).long()].expand(frames.shape[1], -1, -1)
    poses, similar = start, start.new_ones(start.shape[:2])
    columns: dict[str, list[Tensor]] = {}
    seconds = np.zeros(len(frames))
    for step, rows in enumerate(frames):
        began = time.perf_counter()
        if step:
            poses = se2_compose(poses, torch.from_numpy(motion[step]).nan_to_num(0.0)[:, None])
        query = normalize(torch.from_numpy(camera.descriptors[rows]).double() - mean, dim=1)
        found, nearest = (query @ among.T).topk(count, dim=1)
        looked = torch.from_numpy(seen[step])
        poses = torch.where(looked[:, None, None], known.poses[nearest], poses)
        similar = torch.where(looked[:, None], found.clamp(min=LEAST_WEIGHT), similar)
        belief = Belief.of(poses, similar.log())
        answer = estimate(belief, radius)
        seconds[step] = time.perf_counter() - began
        for name, value in {**vars(answer), "ess": belief.ess()}.items():
            columns.setdefault(name, []).append(value)
        if watch is not None:
            watch(step, belief)
    told = {name: torch.stack(values).numpy() for name, values in columns.items()}
    none = np.zeros(frames.shape, np.int64)
    return Track(**told, particles=none + count, injected=none, degenerate=none.astype(bool), seconds=seconds)
