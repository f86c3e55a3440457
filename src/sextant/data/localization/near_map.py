"""The stretch of a drive that leads along map images, where it can be localized at all."""

import math

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from scipy.spatial import cKDTree

from sextant.data.localization.drive import Drive
from sextant.errors import ArgumentError

#: a map image that differs more in heading shows something else
HEADING = math.radians(45)


def along_map(drive: Drive, mapped: Drive, distance: float) -> Bool[ndarray, "n"]:
    """Which frames have a map image within ``distance`` and 45 degrees of heading."""
    tree = cKDTree(mapped.poses[:, :2])
    found = np.zeros(len(drive), bool)
    for frame, near in enumerate(tree.query_ball_point(drive.poses[:, :2], distance)):
        turned = np.cos(mapped.poses[near, 2] - drive.poses[frame, 2])
        found[frame] = bool((turned >= math.cos(HEADING)).any())
    return found


def longest_along_map(drive: Drive, mapped: Drive, distance: float) -> Drive:
    """The longest stretch of a drive along the map, as a drive of its own.

    Raises:
        UserError: there are no two consecutive frames along the map.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], along_map(drive, mapped, distance), [0]]).astype(int)))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts)) if len(starts) else 0
    if not len(starts) or stops[longest] - starts[longest] < 2:
        raise ArgumentError(
            f"near_map={distance:g}: drive {drive.name} has no two consecutive frames that close to a map image",
            "Choose a larger distance, or null.",
            of="DriveSettings",
        )
    return drive.select(int(starts[longest]), int(stops[longest])).renumbered()
