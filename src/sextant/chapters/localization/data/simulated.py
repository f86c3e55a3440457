"""Simulated odometry for drives that have none: of a car, and of a train along a railway."""

import hashlib
import json
import zlib
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.localization.data.drive import motions_along
from sextant.data.rendered import RenderedSource
from sextant.ranges import Positive, Share, checked
from sextant.worlds.odometry import OdometryNoise, simulate

Split = Literal["map", "validation", "test"]


@checked
@dataclass(frozen=True)
class DriveSettings:
    """How drives are made from a dataset.

    Attributes:
        odometry_scale: factor on the noise of simulated odometry; 0 is perfect odometry. Measured odometry is left
            unchanged.
        odometry_seed: of simulated odometry.
        validation_share: share of each drive, from its start, used for validation if a dataset has no drives for it;
            None for the dataset's own share.
        near_map: office drives are cut to the longest stretch with map images within this distance in metres; None
            leaves them whole.

    Raises:
        UserError: a value is out of range.
    """

    odometry_scale: Annotated[float, Ge(0), Le(100)] = 1.0
    odometry_seed: int = 0
    validation_share: Share | None = None
    near_map: Positive | None = None

    def share(self, usual: float) -> float:
        """The validation share, or a dataset's usual one."""
        return usual if self.validation_share is None else self.validation_share

    def identity(self, fingerprint: str) -> str:
        """Hash of a dataset's own fingerprint and of these settings."""
        return hashlib.sha256(json.dumps([fingerprint, asdict(self)]).encode()).hexdigest()


#: A car with wheel encoders and a yaw-rate gyroscope. Assumed, not fitted: no drive here has measured car odometry.
#: Distances are 1 % too long (tyres worn or soft), with a further random error of 1.5 % (0.15 m) over 10 m. The heading
#: has a random error of 0.5 degrees over 10 m, a bias of 0.1 degrees over 10 m, and an error of 1 degree per right
#: angle turned. Sideways, a car slips 5 cm over 10 m. Variances are per metre and per radian, see
#: :class:`OdometryNoise`.
CAR_WHEELS = OdometryNoise(
    forward_scale=0.01,
    turn_scale=0.0,
    lateral_bias=0.0,
    turn_bias=float(np.radians(0.01)),
    per_metre=(0.15**2 / 10, 0.05**2 / 10, float(np.radians(0.5)) ** 2 / 10),
    per_radian=(0.0, 0.0, float(np.radians(1.0)) ** 2 / (np.pi / 2)),
)

#: Standard deviation, in frames, of the odometry of a one-frame step on a railway: a tenth of a frame, which on a train
#: at 100 km/h and one frame per second is 3 m in 28 m. The variance is proportional to the step.
FRAME_SIGMA = 0.1


def simulated_motion(
    poses: Float64[ndarray, "n 3"], noise: OdometryNoise, scale: float, seed: int, drive: str
) -> Float64[ndarray, "n 3"]:
    """Motions that wheels report along true poses; drives of different names have different errors.

    Args:
        poses: ground truth.
        noise: of the wheels.
        scale: factor on the noise; 0 is perfect odometry.
        seed: of the errors.
        drive: its name.
    """
    return motions_along(simulate(poses, noise.scaled(scale), _rng(seed, drive)))


def simulated_railway_motion(
    frames: Float64[ndarray, "n"], scale: float, seed: int, drive: str
) -> Float64[ndarray, "n 3"]:
    """Motions along a railway: ``u_x = d + sqrt(|d|) n``, ``n ~ N(0, (scale FRAME_SIGMA)²)``, d the true step.

    There is no rotation and no sideways motion.
    """
    step = np.diff(frames, prepend=frames[:1])
    noise = _rng(seed, drive).normal(size=len(step)) * scale * FRAME_SIGMA
    return np.column_stack([step + np.sqrt(np.abs(step)) * noise, np.zeros((len(step), 2))])


def _rng(seed: int, drive: str) -> np.random.Generator:
    return np.random.default_rng([seed, 71, zlib.crc32(drive.encode())])


class DrivenWorld(RenderedSource):
    """The drives of a rendered world, made with given settings."""

    def __init__(self, dataset: Any, settings: DriveSettings | None = None):
        super().__init__(dataset)
        self.settings = settings or DriveSettings()

    def conditions(self) -> tuple[str, ...]:
        """The conditions of the config, the map's first; nothing is rendered."""
        return tuple(self.dataset.plan().condition_names)

    def fingerprint(self) -> str:
        """Hash of the config, of the source that renders it, and of the settings."""
        return self.settings.identity(super().fingerprint())
