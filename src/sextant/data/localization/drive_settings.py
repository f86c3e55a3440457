"""The splits of a dataset to localize in, and how its drives are made."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Literal

from sextant.errors import ArgumentError

Split = Literal["map", "validation", "test"]


@dataclass(frozen=True)
class DriveSettings:
    """How drives are made of a dataset.

    Attributes:
        odometry_scale: by which the noise of simulated odometry is multiplied; 0 is perfect odometry. Odometry that
            was measured stays as it is.
        odometry_seed: of simulated odometry.
        validation_share: part of each drive, from its start, that is for validation, where a dataset has no drives for
            it; None for the dataset's own.
        near_map: drives of an office are cut to the longest stretch with images of the map so near, in metres; None
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
