"""A room of boxes seen by a known camera: exact pictures and exact segments."""

import math

import numpy as np
import torch

from sextant.geometry import PerspectiveCamera, k2_of_k1, perspective_project, rotation_from_tilt_roll

#: Half sizes of the room, and where the camera stands in it.
ROOM = np.array([3.0, 1.5, 4.0])
PLACE = np.array([0.6, 0.2, -0.7])


def camera_from_room(tilt, roll, heading):
    """Rotation from the room's axes (x right, y down, z forward) to the camera's."""
    gravity_from_camera = rotation_from_tilt_roll(*torch.tensor([tilt, roll], dtype=torch.float64)).numpy()
    c, s = math.cos(heading), math.sin(heading)
    return gravity_from_camera.T @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def project(points, tilt, roll, heading, focal, k1):
    """Image heights of points in the room's axes, and which of them are seen; by the package's own camera."""
    directions = torch.as_tensor(points @ camera_from_room(tilt, roll, heading).T)
    focal, k1 = torch.tensor([focal, k1], dtype=torch.float64)
    seen, visible = perspective_project(directions, focal, k1, k2_of_k1(k1))
    return seen.numpy(), visible.numpy()


def segments(tilt, roll, heading, focal, k1=0.0, *, count=60, noise=0.0, outliers=0.0, aspect=4 / 3, seed=0):
    """Ends of short edges along the axes of the room, inside the image, longest first; noise in image heights."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        start = rng.uniform(-1, 1, (500, 3)) * [4, 3, 1] + [0, 0, 5]
        start = start @ camera_from_room(0.0, 0.0, rng.uniform(-0.5, 0.5))  # where there is something to see
        end = start + np.eye(3)[rng.integers(3, size=500)] * rng.uniform(0.3, 2, (500, 1))
        (a, seen_a), (b, seen_b) = (project(p, tilt, roll, heading, focal, k1) for p in (start, end))
        inside = seen_a & seen_b & (np.abs([a, b]) < [aspect / 2, 0.5]).all((0, 2))
        found += list(np.stack([a, b], axis=1)[inside])
    ends = np.array(found[:count])
    wrong = int(outliers * count)
    ends[:wrong] = ends[:wrong].mean(1, keepdims=True) + rng.normal(0, 0.1, (wrong, 2, 2))
    ends = ends + rng.normal(0, noise, ends.shape) if noise else ends
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    ends = ends[lengths > 0.03]
    return ends[np.argsort(-np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1))]


def picture(tilt, roll, heading, focal, k1=0.0, *, width=256, height=192, noise=0.0, clutter=0, samples=4, seed=0):
    """The room with windows on its walls, each pixel the mean of ``samples`` squared rays; noise in grey levels."""
    camera = PerspectiveCamera.from_focal(float(focal), width, height, k1=float(k1))
    rays = camera.bearings(camera.ray_grid(samples)).numpy().astype(np.float64)
    rays = rays @ camera_from_room(tilt, roll, heading)
    with np.errstate(divide="ignore"):
        distances = (np.sign(rays) * ROOM - PLACE) / rays
    wall = distances.argmin(-1)
    points = PLACE + rays * np.take_along_axis(distances, wall[..., None], -1)
    grey = np.zeros(rays.shape[:-1])
    rng = np.random.default_rng(seed)
    for axis in range(3):
        for side in (-1, 1):
            here = (wall == axis) & (np.sign(rays[..., axis]) == side)
            across, along = (points[here][:, other] + 10 for other in range(3) if other != axis)
            (p, q), (a, b) = rng.uniform(0.7, 1.4, 2), rng.uniform(0.35, 0.6, 2)
            phase = rng.uniform(0, 1, 2)
            window = ((across / p + phase[0]) % 1 < a) & ((along / q + phase[1]) % 1 < b)
            wall_grey, window_grey = rng.uniform(120, 230), rng.uniform(20, 90)
            grey[here] = np.where(window, window_grey, wall_grey)
    image = grey.mean(-1)
    rows, columns = np.mgrid[:height, :width]
    for _ in range(clutter):  # discs: edges that are no lines
        x, y, r = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(5, 25)
        image = np.where(np.hypot(columns - x, rows - y) < r, rng.uniform(0, 255), image)
    image = image + noise * rng.standard_normal(image.shape)
    return np.repeat(np.clip(np.round(image), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def cameras(count, seed=0, k1=(-0.4, 0.0)):
    """Tilt, roll, heading, focal length and k1 of random cameras whose headings show two walls."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield (
            rng.uniform(-0.35, 0.35),
            rng.uniform(-0.2, 0.2),
            rng.choice([-1, 1]) * rng.uniform(0.35, 1.2),
            rng.uniform(0.6, 1.1),
            rng.uniform(*k1),
        )
