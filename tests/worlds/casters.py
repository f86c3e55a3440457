"""Scenes whose distances are known in closed form."""

import numpy as np


class Circle:
    """A vertical cylinder around the origin, seen from both sides."""

    def __init__(self, radius):
        self.radius = radius

    def distance(self, origins, directions):
        p, d = origins[:, :2], directions[:, :2]
        along = (p * d).sum(axis=1)
        square = along**2 - (p**2).sum(axis=1) + self.radius**2
        half = np.sqrt(np.maximum(square, 0))
        near, far = -along - half, -along + half
        return np.where((square < 0) | (far <= 0), np.inf, np.where(near > 0, near, far))


class Boxes:
    """Axis-parallel walls of any height around rectangles (left, bottom, right, top), seen from both sides."""

    def __init__(self, *boxes):
        self.boxes = boxes

    def distance(self, origins, directions):
        nearest = np.full(len(origins), np.inf)
        for left, bottom, right, top in self.boxes:
            for axis, at, low, high in (
                (0, left, bottom, top),
                (0, right, bottom, top),
                (1, bottom, left, right),
                (1, top, left, right),
            ):
                with np.errstate(divide="ignore", invalid="ignore"):
                    t = (at - origins[:, axis]) / directions[:, axis]
                    other = origins[:, 1 - axis] + t * directions[:, 1 - axis]
                hit = np.isfinite(t) & (t > 0) & (other >= low) & (other <= high)
                nearest = np.where(hit, np.fmin(nearest, t), nearest)
        return nearest


class Nothing:
    def distance(self, origins, directions):
        return np.full(len(origins), np.inf)
