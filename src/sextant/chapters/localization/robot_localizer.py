r"""A localizer between a robot's messages: what a node of ROS 1 or 2 computes, without ROS.

REP 105 names the frames: *map*, in which the robot is localized and may jump; *odom*, in which it moves smoothly and
drifts; *base*, fixed to it. Odometry reports odom from base, and a localizer publishes

.. math:: T_{map \leftarrow odom} = T_{map \leftarrow base}(t)\; T_{odom \leftarrow base}(t)^{-1}

with both at the time t of the image. The localized camera may be mounted anywhere on the base. Source: W. Meeussen,
"Coordinate frames for mobile platforms", REP 105.
"""

import math
import time
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from sextant.chapters.localization.data.drive import between, compose
from sextant.chapters.localization.data.ros_messages import RosCamera, picture_of
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.localization.localizer import Localizer
from sextant.data.image_files import picture_bytes
from sextant.data.pixel_values import WhiteLevels
from sextant.errors import ArgumentError, UserError
from sextant.localization.initialisation import GaussianStart
from sextant.localization.innovation_test import drawn_evenly

SECOND = 10**9
#: seconds of odometry that are kept
KEPT_S = 30.0
#: a stamp this many seconds before the newest of its topic means that time was set back, as when a bag is played again
SET_BACK_S = 1.0
#: standard deviations (metres, rad) of an initial pose whose variances are 0: those of RViz
USUAL_SIGMAS = (0.5, 0.5, math.pi / 12)
#: rows of x, y and yaw among x, y, z and the rotations about them
PLANE = np.ix_([0, 1, 5], [0, 1, 5])
Level = Literal["OK", "WARN", "ERROR"]


@dataclass(frozen=True)
class Diagnostics:
    """The state of the localizer, as ``diagnostic_msgs/DiagnosticStatus`` has it.

    Attributes:
        level: ``ERROR`` where the robot is lost, ``WARN`` where it may become so.
        message: why, in words.
        values: numbers by name.
    """

    level: Level
    message: str
    values: dict[str, str]


@dataclass(frozen=True, eq=False)
class Report:
    """What is published after an image.

    Attributes:
        stamp_ns: of the image.
        lost: the pose should not be published.
        pose: x, y, heading of the base in the map.
        covariance: of x, y, z and the rotations about them, by rows; those of z, roll and pitch are 0.
        map_from_odom: None while the robot is lost or odometry at the image's time is unknown; after an initial pose,
            that pose's until the fifth image, from which on images decide whether the robot is lost.
        particles: base poses of equal weight, drawn from the belief.
        diagnostics: the state.
    """

    stamp_ns: int
    lost: bool
    pose: Float64[ndarray, "3"]
    covariance: Float64[ndarray, "6 6"]
    map_from_odom: Float64[ndarray, "3"] | None
    particles: Float64[ndarray, "n 3"]
    diagnostics: Diagnostics


@dataclass(eq=False)
class OdometryBuffer:
    """The newest odometry, interpolated in time.

    Example:
        >>> buffer = OdometryBuffer()
        >>> for second, x in ((0, 0.0), (1, 2.0)):
        ...     buffer.add(second * SECOND, np.array([x, 0.0, 0.0]))
        >>> buffer.at(SECOND // 4)
        array([0.5, 0. , 0. ])
    """

    _kept: deque[tuple[int, Float64[ndarray, "3"]]] = field(default_factory=deque)

    @property
    def newest_ns(self) -> int | None:
        """The newest time; None if there is none."""
        return self._kept[-1][0] if self._kept else None

    def add(self, stamp_ns: int, odom_from_base: Float64[ndarray, "3"]) -> None:
        """Add a pose; one that is not newer than the newest is left out."""
        if self._kept and stamp_ns <= self._kept[-1][0]:
            return
        self._kept.append((stamp_ns, odom_from_base))
        while self._kept[-1][0] - self._kept[0][0] > KEPT_S * SECOND:
            self._kept.popleft()

    def at(self, stamp_ns: int) -> Float64[ndarray, "3"] | None:
        """The pose at a time, between the two around it; None if it is not between the oldest and the newest."""
        if not self._kept or not self._kept[0][0] <= stamp_ns <= self._kept[-1][0]:
            return None
        for (before, first), (after, second) in pairwise(reversed(self._kept)):
            if after <= stamp_ns:
                share = (stamp_ns - after) / (before - after)
                turn = (first[2] - second[2] + math.pi) % (2 * math.pi) - math.pi
                return np.array([*((1 - share) * second[:2] + share * first[:2]), second[2] + share * turn])
        return self._kept[0][1]


class RobotLocalizer:
    """Localizes a robot by its messages; each method returns what is to be published.

    Args:
        localizer: of the map; its poses are those of the camera.
        mounting: the camera on the base: metres ahead, metres to the left, degrees to the left.
        odometry_timeout_s: how long an image waits for odometry of its time, by the stamps of later messages.
        rectify: straighten images by the camera's distortion; images before its first message are left out.

    Raises:
        UserError: the map cannot describe images, or an argument is out of range.
    """

    def __init__(
        self,
        localizer: Localizer,
        *,
        mounting: tuple[float, float, float] = (0.0, 0.0, 0.0),
        odometry_timeout_s: float = 0.5,
        rectify: bool = False,
    ):
        if len(mounting) != 3 or not np.isfinite(mounting).all():
            raise ArgumentError(
                f"mounting={list(mounting)} must be metres ahead, metres to the left, degrees to the left",
                "mounting=[0.0, 0.0, 0.0] for a camera in the middle of the base that looks ahead",
            )
        if not 0 <= odometry_timeout_s < math.inf:
            raise ArgumentError(
                f"odometry_timeout_s={odometry_timeout_s} must be at least 0 and finite", "For example 0.5"
            )
        if localizer.descriptor.describer is None or localizer.image_size is None:
            raise UserError(
                "the map was built from descriptors computed elsewhere, so images cannot be described",
                "Use a map of images: a run of task=localization, or Localizer.from_images(...).save(folder).",
            )
        self.localizer, self.rectify = localizer, rectify
        self._base_from_camera = np.array([[mounting[0], mounting[1], math.radians(mounting[2])]])
        self._timeout_ns, self._size = round(odometry_timeout_s * SECOND), localizer.image_size
        self._levels = WhiteLevels([], "images of the camera")
        self.camera: RosCamera | None = None
        self.map_from_odom: Float64[ndarray, "3"] | None = None  #: the newest; None until the robot is localized
        self._begins: tuple[int, Float64[ndarray, "3"], tuple[float, float, float]] | None = None
        self._given: Float64[ndarray, "3"] | None = None  # map from odom by an initial pose, until images decide
        self._forget()
        self.images = self.left_out = 0

    def _forget(self) -> None:
        """Discard messages, whose times no longer count."""
        self._odometry = OdometryBuffer()
        self._waiting: list[tuple[int, Any, str]] = []
        self._before: Float64[ndarray, "3"] | None = None  # odometry at the last image
        self._newest_image_ns = -1

    # -- messages ------------------------------------------------------------------------------------------------------

    def on_camera(self, camera: RosCamera | None) -> None:
        """The camera of the images, from ``sensor_msgs/CameraInfo``; None: it is not calibrated."""
        self.camera = camera

    def on_odometry(self, stamp_ns: int, odom_from_base: Float64[ndarray, "3"]) -> list[Report]:
        """A pose of the base in its odometry frame (x, y, heading); reports on the images that waited for it."""
        self._arrived(stamp_ns, self._odometry.newest_ns)
        self._odometry.add(stamp_ns, np.asarray(odom_from_base, np.float64))
        return self._ready()

    def on_image(self, stamp_ns: int, message: Any, kind: str = "sensor_msgs/msg/Image") -> list[Report]:
        """An image, as ``picture_of`` reads it; reports on images whose odometry is known, or will not come."""
        self._arrived(stamp_ns, self._newest_image_ns)
        if stamp_ns <= self._newest_image_ns:
            self.left_out += 1  # older than one before it
            return []
        self._newest_image_ns = stamp_ns
        self._waiting.append((stamp_ns, message, kind))
        return self._ready()

    def on_initial_pose(
        self, stamp_ns: int, map_from_base: Float64[ndarray, "3"], covariance: Float64[ndarray, "6 6"] | None = None
    ) -> None:
        """Start again around a pose of the base, at the next image; odometry since the pose's time is added to it.

        Args:
            stamp_ns: time of the pose; 0 if it is now.
            map_from_base: x, y, heading.
            covariance: of which the variances of x, y and yaw are used; those of 0 become those of RViz.

        Raises:
            UserError: a number is not finite, or a variance is negative.
        """
        given = (
            np.zeros(3) if covariance is None else np.asarray(covariance, np.float64).reshape(6, 6)[PLANE].diagonal()
        )
        pose = np.asarray(map_from_base, np.float64)
        if not np.isfinite([*pose, *given]).all() or (given < 0).any():
            raise UserError(
                f"initial pose {pose.tolist()} with variances {given.tolist()} is none", "Finite, at least 0."
            )
        sigmas = tuple(math.sqrt(each) or usual for each, usual in zip(given.tolist(), USUAL_SIGMAS, strict=True))
        self._begins = (stamp_ns, pose, (sigmas[0], sigmas[1], sigmas[2]))
        at = self._odometry.at(stamp_ns or max(self._newest_image_ns, self._odometry.newest_ns or 0))
        self._given = self.map_from_odom = None if at is None else _map_from_odom(pose, at)

    # -- steps ---------------------------------------------------------------------------------------------------------

    def _arrived(self, stamp_ns: int, newest_ns: int | None) -> None:
        """Begin anew if time was set back since the newest message of the same topic; topics differ in latency."""
        if newest_ns is not None and newest_ns - stamp_ns > SET_BACK_S * SECOND:
            self.left_out += len(self._waiting)
            self.map_from_odom = self._given = None  # of odometry that no longer counts
            self._forget()

    def _ready(self) -> list[Report]:
        """Steps with the images that need not wait for odometry any longer."""
        newest, reports = self._odometry.newest_ns, []
        while self._waiting:
            stamp_ns = self._waiting[0][0]
            if newest is not None and newest < stamp_ns and self._newest_image_ns - stamp_ns <= self._timeout_ns:
                break
            reports.append(self._step(*self._waiting.pop(0)))
        return reports

    def _step(self, stamp_ns: int, message: Any, kind: str) -> Report:
        began = time.perf_counter()
        here = self._odometry.at(stamp_ns)
        if self._begins is not None:
            self._restart(here)
        motion = None
        if self._before is not None and here is not None:  # of the camera
            bases = np.stack([self._before, here])
            cameras = compose(bases, np.repeat(self._base_from_camera, 2, axis=0))
            motion = between(cameras[:1], cameras[1:])[0]
        self._before = here
        pixels, problem = self._pixels(message, kind)
        self.images, self.left_out = self.images + 1, self.left_out + (pixels is None)
        told = self.localizer.step(motion, pixels)
        pose = self._base(told.pose[None])[0]
        if not (told.lost and math.isnan(told.foreseen)):
            self._given = None
        found = None if told.lost or here is None else _map_from_odom(pose, here)
        self.map_from_odom = self._given if found is None else found
        belief = self.localizer.belief
        rows = drawn_evenly(belief.weights)[0]
        return Report(
            stamp_ns,
            told.lost,
            pose,
            self._covariance(told, float(pose[2])),
            self.map_from_odom,
            self._base(belief.poses[0, rows].numpy()),
            self._diagnostics(told, problem, here is None, 1000 * (time.perf_counter() - began)),
        )

    def _restart(self, here: Float64[ndarray, "3"] | None) -> None:
        """Reset the localizer to the initial pose, moved by the odometry since its time."""
        assert self._begins is not None
        stamp_ns, pose, sigmas = self._begins
        since = self._odometry.at(stamp_ns) if stamp_ns else None
        if since is not None and here is not None:
            pose = compose(pose[None], between(since[None], here[None]))[0]
        camera = compose(pose[None], self._base_from_camera)
        self.localizer.reset(start=GaussianStart(torch.from_numpy(camera), sigmas))
        self._begins, self._given = None, None if here is None else _map_from_odom(pose, here)

    def _pixels(self, message: Any, kind: str) -> tuple[ndarray | None, str]:
        """The image as the map's images are; None if it cannot be used, and why."""
        try:
            picture = picture_of(message, kind)
            if not self.rectify:
                return picture_bytes(picture, *self._size, levels=self._levels), ""
            if self.camera is None:
                return None, "rectify is set, but no calibrated camera_info has arrived"
            pixels = picture_bytes(picture, picture.height, picture.width, self._size[2], levels=self._levels)
            straight = self.camera.straight(pixels, "the image")
            image = Image.fromarray(straight if straight.shape[2] == 3 else straight[..., 0])
            return picture_bytes(image, *self._size), ""
        except (UserError, ValueError, OSError) as error:  # of decoders
            return None, f"an image was left out: {str(error).splitlines()[0]}"

    def _base(self, cameras: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        """Poses of the base from those of the camera."""
        back = between(self._base_from_camera, np.zeros((1, 3)))
        return compose(np.asarray(cameras, np.float64), np.repeat(back, len(cameras), axis=0))

    def _covariance(self, told: LocalizedPose, heading: float) -> Float64[ndarray, "6 6"]:
        """The covariance of the base: an error of the heading turns the base about the camera."""
        ahead, left = self._base_from_camera[0, :2]
        c, s = math.cos(heading), math.sin(heading)
        lever = np.array([[1, 0, s * ahead + c * left], [0, 1, -c * ahead + s * left], [0, 0, 1.0]])
        covariance = np.zeros((6, 6))
        covariance[PLANE] = lever @ told.covariance @ lever.T
        return covariance

    def _diagnostics(self, told: LocalizedPose, problem: str, unmoved: bool, milliseconds: float) -> Diagnostics:
        level: Level = "OK"
        message = "localized"
        for wrong, severity, words in (
            (self._given is not None, "WARN", "not found yet near the initial pose"),
            (told.lost, "ERROR", f"lost: the likeliest place has weight {told.mass:.0%}"),
            (bool(problem), "WARN", problem),
            (told.off_map > 0.5, "WARN", "probably outside of the mapped area"),
            (told.disbelieved, "WARN", "odometry reports a standstill, but images change"),
            (unmoved, "WARN", "no odometry at the time of the image: no transform"),
            (told.degenerate, "WARN", "no particle explains the image"),
        ):
            if wrong:
                level, message = ("ERROR" if severity == "ERROR" else "WARN"), words
                break
        values = {
            "lost": str(told.lost).lower(), "mass": f"{told.mass:.3f}", "modes": str(told.modes),
            "off_map": f"{told.off_map:.3f}", "foreseen": f"{told.foreseen:.3f}",
            "recognised": f"{told.recognised:.3f}", "sigma_x": f"{told.sigmas[0]:.3f}",
            "sigma_y": f"{told.sigmas[1]:.3f}", "sigma_heading_deg": f"{math.degrees(told.sigmas[2]):.2f}",
            "odometry_scale": f"{self.localizer.odometry_scale:.3f}", "images": str(self.images),
            "images_left_out": str(self.left_out), "step_ms": f"{milliseconds:.1f}",
        }  # fmt: skip
        return Diagnostics(level, message, values)


def _map_from_odom(
    map_from_base: Float64[ndarray, "3"], odom_from_base: Float64[ndarray, "3"]
) -> Float64[ndarray, "3"]:
    inverse = between(odom_from_base[None], np.zeros((1, 3)))
    found: Float64[ndarray, "3"] = compose(map_from_base[None], inverse)[0]
    return found
