"""Drives made up for tests."""

import numpy as np

from sextant.chapters.localization.data import Drive
from sextant.chapters.localization.data.drive import motions_along
from sextant.chapters.places.data import ImageRows


def circle(n=40, radius=20.0, name="circle", condition="day", noise=0.0, seed=0, **more):
    """A drive around a circle whose pictures tell their frame; motions are exact, or err."""
    turn = 2 * np.pi * np.arange(n) / n
    heading = (turn + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    poses = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), heading])
    pictures = np.broadcast_to(np.arange(n, dtype=np.uint8)[:, None, None, None], (n, 4, 6, 3))
    motion = motions_along(poses)
    motion[1:] += noise * np.random.default_rng(seed).normal(size=(n - 1, 3))
    laser = np.arange(n, dtype=np.float32)[:, None] + np.zeros(5, np.float32)
    return Drive.of(
        name, condition, poses, motion=motion, images=ImageRows(pictures), laser=laser, odometry="simulated", **more
    )


def numbers(drive):
    """The frames that the pictures of a drive tell."""
    return drive.images[:][:, 0, 0, 0]
