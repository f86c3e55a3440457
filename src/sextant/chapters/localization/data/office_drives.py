"""Drives through a rendered office, and the parts of them near its map."""

import math

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from scipy.spatial import cKDTree

from sextant.chapters.localization.data.drive import Drive, LocalizationData, first_share, motions_along
from sextant.chapters.localization.data.simulated import DrivenWorld, simulated_motion
from sextant.chapters.places.data import ImageRows
from sextant.correspondence.pinhole import Pinhole
from sextant.data.rendered import open_store
from sextant.data.rendered.splits import RenderedSplit
from sextant.errors import ArgumentError
from sextant.worlds.odometry import COLD_WHEELS

#: map images that differ more in heading are not near a frame
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


#: of the run, if there is only one
VALIDATION_SHARE = 0.25
#: scale and seed of the odometry stored with the pictures
STORED = (1.0, 0)


class OfficeDrives(DrivenWorld):
    """The drives of :class:`~sextant.data.worlds.OfficeWalk`.

    The first drive makes the map. With several runs, the first is for validation, under each condition, and the others
    for the test; with a single run, its first quarter is for validation. Odometry is measured if a trajectory file
    contains it, and simulated otherwise.
    """

    def read(self) -> LocalizationData:
        """All drives, rendered first if necessary; pictures stay in their file."""
        mapped = self.read_split("map", "metres=[160,80,80]")
        driven = self.read_split("run", "metres=[160,80,80]")
        plan = self.dataset.plan()
        store = open_store(plan, self.dataset.cache)
        laser = store.mapped("laser", np.arange(len(store)), self.threads)
        conditions = list(driven.facts["conditions"])
        measured: list[bool] = driven.facts["measured_odometry"]
        drives: list[list[Drive]] = [[] for _ in measured]
        whole = np.arange(len(mapped.rows))
        first = self._drive(mapped, whole, laser, "map", conditions[0], measured=measured[0])
        for run in np.unique(driven.columns["run"]):
            rows = np.flatnonzero(driven.columns["run"] == run)
            number = 1 + (int(run) - 1) // len(conditions)  # every drive except the map's is made under each condition
            condition = conditions[int(driven.columns["condition"][rows[0]])]
            name = f"run{number}/{condition}"
            drive = self._drive(driven, rows, laser, name, condition, measured=measured[number])
            if self.settings.near_map is not None:
                drive = longest_along_map(drive, first, self.settings.near_map)
            drives[number].append(drive)
        runs = drives[1:]
        if len(runs) > 1:
            validation, test = tuple(runs[0]), tuple(drive for run in runs[1:] for drive in run)
        else:
            validation, test = first_share(runs[0], self.settings.share(VALIDATION_SHARE))
        lens = plan.config
        focal_px = lens["height"] / 2 / math.tan(math.radians(lens["vfov_deg"]) / 2)
        camera = Pinhole.centred(lens["width"], lens["height"], focal_px)
        return LocalizationData(first, test, validation, None, "m", "office", plan.scanner, camera=camera)

    def _drive(
        self, split: RenderedSplit, rows: ndarray, laser: ndarray, name: str, condition: str, *, measured: bool
    ) -> Drive:
        poses = np.ascontiguousarray(split.columns["pose"][rows][:, [0, 1, 3]])
        told = motions_along(split.columns["odometry"][rows])
        scale, seed = self.settings.odometry_scale, self.settings.odometry_seed
        if not measured and (scale, seed) != STORED:
            told = simulated_motion(poses, COLD_WHEELS, scale, seed, name)
        return Drive.of(
            name,
            condition,
            poses,
            motion=told,
            images=ImageRows(split.images, split.rows[rows]),
            laser=laser[split.rows[rows]],
            odometry="measured" if measured else "simulated",
        )
