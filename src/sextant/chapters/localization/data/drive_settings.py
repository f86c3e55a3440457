"""The splits of a localization dataset, and how its drives are made."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Literal

from sextant.errors import ArgumentError

Split = Literal["map", "validation", "test"]


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

    odometry_scale: float = 1.0
    odometry_seed: int = 0
    validation_share: float | None = None
    near_map: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.odometry_scale <= 100:
            raise ArgumentError(
                f"odometry_scale={self.odometry_scale:g} must be in [0, 100]", "odometry_scale=1", of=self
            )
        if self.validation_share is not None and not 0 < self.validation_share < 1:
            raise ArgumentError(
                f"validation_share={self.validation_share:g} must be within (0, 1)", "validation_share=0.25", of=self
            )

    def share(self, usual: float) -> float:
        """The validation share, or a dataset's usual one."""
        return usual if self.validation_share is None else self.validation_share

    def identity(self, fingerprint: str) -> str:
        """Hash of a dataset's own fingerprint and of these settings."""
        return hashlib.sha256(json.dumps([fingerprint, asdict(self)]).encode()).hexdigest()
