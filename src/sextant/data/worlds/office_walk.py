"""A robot in an office: pictures, poses, odometry and laser scans of drives through it."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.rendered import ArraySpec
from sextant.data.worlds.shots import Shots, WorldPlan
from sextant.data.worlds.towns import RenderedWorld, file_hashes, perspective
from sextant.geometry import Camera
from sextant.worlds.appearance import Appearance
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.odometry import COLD_WHEELS, at_axle, increments, integrate, simulate
from sextant.worlds.office import Office
from sextant.worlds.office_carving import plan_along
from sextant.worlds.office_layouts import procedural_plan
from sextant.worlds.office_plan import FloorPlan
from sextant.worlds.office_routes import revisit, survey
from sextant.worlds.renderer import Renderer
from sextant.worlds.trajectories import load_cold

CAMERA_HEIGHT_M, LASER_HEIGHT_M = 0.9, 0.3


class OfficeWalkPlan(WorldPlan):
    """Runs through one office; see :class:`OfficeWalk`."""

    chunk = 64

    @property
    def camera(self) -> Camera:
        """A camera on the robot, looking ahead."""
        return perspective(self.config["width"], self.config["height"], self.config["vfov_deg"])

    @property
    def splits(self) -> tuple[str, ...]:
        """The run that the map is made from, and the runs to localize."""
        return ("map", "run")

    @cached_property
    def scanner(self) -> LaserScanner:
        """The robot's laser."""
        return LaserScanner(height_m=LASER_HEIGHT_M, **self.config["laser"])

    @cached_property
    def _drives(self) -> list[Float64[ndarray, "n 3"]]:
        """Poses of the map drive and of each run."""
        if self.config["trajectories"]:
            drives = [load_cold(path).poses for path in self.config["trajectories"]]
            return [drive[:: max(1, self.config["every"])] for drive in drives]
        step = 0.04 * self.config["every"]
        first, *others = self.config["metres"]
        rngs = [np.random.default_rng([self.config["seed"], 60, k]) for k in range(len(others) + 1)]
        mapped = survey(self._empty_plan, first, step, rngs[0])
        runs = [
            revisit(self._empty_plan, mapped[:, :2], metres, step, rng)
            for metres, rng in zip(others, rngs[1:], strict=True)
        ]
        return [mapped, *runs]

    @cached_property
    def _measured(self) -> list[Float64[ndarray, "n 3"] | None]:
        """Real odometry of each drive, at the poses of :attr:`_drives`; None for what has to be simulated."""
        if not self.config["trajectories"]:
            return [None] * len(self.config["metres"])
        told = [load_cold(path).odometry for path in self.config["trajectories"]]
        every = max(1, self.config["every"])
        return [None if odometry is None else odometry[::every] for odometry in told]

    @cached_property
    def _empty_plan(self) -> FloorPlan:
        return procedural_plan(tuple(self.config["size_m"]), self.config["seed"])

    @cached_property
    def office(self) -> Office:
        """The building: procedural, or carved around the trajectories."""
        seed, files = self.config["seed"], self.config["trajectories"]
        if files:
            return Office(plan_along(*(load_cold(path).poses for path in files), seed=seed), seed)
        plan = self._empty_plan
        tracks = tuple(plan.to_plan(drive[:, :2]) for drive in self._drives)  # furniture keeps off them
        return Office(replace(plan, tracks=tracks), seed)

    def lay_out(self) -> Shots:
        """The map drive, then each run under each condition; the map is seen under the first."""
        parts = []
        for k, drive in enumerate(self._drives):
            x, y, heading = drive.T
            zero = np.zeros(len(x))
            pose = np.column_stack([x, y, zero + CAMERA_HEIGHT_M, heading, zero, zero])
            conditions = range(1 if k == 0 else len(self.appearances))
            parts += [Shots.of(0, condition, int(k > 0), np.arange(len(x)), pose) for condition in conditions]
        return Shots.join(parts)

    @property
    def arrays(self) -> Mapping[str, ArraySpec]:
        """Pictures and laser scans in metres."""
        return {**super().arrays, "laser": ArraySpec((self.scanner.beams,), np.float32)}

    @cached_property
    def columns(self) -> Mapping[str, ndarray]:
        """Labels, the run of each picture (0 is the map's), and the pose according to its wheels.

        Odometry starts at the true first pose and drifts away from it. It is that of the real robot where the
        trajectory's file has it, and simulated otherwise.
        """
        shots = self.shots
        starts = np.flatnonzero(np.r_[True, np.diff(shots.place) <= 0])
        run = np.searchsorted(starts, np.arange(len(shots)), side="right") - 1
        odometry = [self._odometry(k, shots.pose[run == k][:, [0, 1, 3]]) for k in range(len(starts))]
        return {**super().columns, "run": run.astype(np.int16), "odometry": np.concatenate(odometry)}

    def _odometry(self, run: int, truth: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        measured = self._measured[0 if run == 0 else 1 + (run - 1) // len(self.appearances)]
        if measured is None:
            return simulate(truth, COLD_WHEELS, np.random.default_rng([self.config["seed"], 61, run]))
        lever = COLD_WHEELS.lever_m  # wheels tell how their axle moves, which is behind the frame of the poses
        return at_axle(integrate(at_axle(truth[:1], lever)[0], increments(measured)), -lever)

    def build(self, scene: int, appearance: Appearance) -> Renderer:
        """The office under an appearance."""
        return self.office.renderer(appearance)

    def render(self, start: int, stop: int) -> Mapping[str, ndarray]:
        """Pictures and scans ``start`` to ``stop``."""
        return {**super().render(start, stop), "laser": np.stack([self._scan(i) for i in range(start, stop)])}

    def _scan(self, i: int) -> ndarray:
        renderer, _ = self.view_of(i)
        pose, rng = self.shots.pose[i : i + 1, [0, 1, 3]], np.random.default_rng([self.config["seed"], 62, i])
        return np.asarray(scan(self.scanner, renderer.scene, pose, rng)[0], np.float32)

    def describe(self) -> dict[str, Any]:
        """The floor, the length of each drive, and whether its odometry was measured."""
        lengths = [float(np.linalg.norm(np.diff(drive[:, :2], axis=0), axis=1).sum()) for drive in self._drives]
        return {
            "floor_square_metres": round(self.office.floor_area_m2, 1),
            "drives_m": [round(m, 1) for m in lengths],
            "measured_odometry": [odometry is not None for odometry in self._measured],
        }


class OfficeWalk(RenderedWorld):
    """Drives of a robot through an office: a map run, and runs to localize, with odometry and laser.

    Odometry errs as :data:`~sextant.worlds.odometry.COLD_WHEELS` do, or is that of the trajectory's file if it has any.

    Keys: ``size_m`` and ``metres`` of each drive (procedural), or ``trajectories`` (files of poses that the office is
    carved around: COLD's layout); ``every`` how many poses 4 cm apart a picture is taken; ``width``, ``height``,
    ``vfov_deg``, ``samples``, ``conditions`` (the first is the map's), ``laser``, ``seed``.
    """

    name = "office_walk"
    plan_type = OfficeWalkPlan

    def plan(self) -> WorldPlan:
        """What is rendered; the contents of trajectory files are part of its identity."""
        config = {**self.config, "trajectory_sha256": file_hashes(self.config["trajectories"])}
        return OfficeWalkPlan(self.name, config, list(config["conditions"]), config["samples"])
