"""The definitions behind all results, fixed before any result was obtained."""

from dataclasses import dataclass
from typing import Literal

#: A claim needs this many seeds; with fewer, it is labelled exploratory. With 5 a sign test cannot go below p = 0.0625.
SEEDS_FOR_A_CLAIM = 8

#: Number of worlds (independently drawn layouts, or sources of real data) that a claim needs where worlds are the unit
#: of replication: each has runs of its own, and t intervals over three are valid, if wide.
WORLDS_FOR_A_CLAIM = 3

#: A classification run has converged if its validation accuracy after training is at least this share of the way from
#: chance to 1. It is judged on the validation split alone. Runs below are reported as diverged, counted, and never
#: dropped silently.
CONVERGED_ABOVE_CHANCE = 0.5


def classification_converged(validation_accuracy: float, num_classes: int) -> bool:
    """Whether a trained classifier learnt at all: ``accuracy >= chance + 0.5 (1 - chance)``, chance being 1/K.

    >>> classification_converged(0.56, num_classes=10), classification_converged(0.54, num_classes=10)  # from 0.55 on
    (True, False)
    """
    chance = 1 / num_classes
    return validation_accuracy >= chance + CONVERGED_ABOVE_CHANCE * (1 - chance)


#: A calibration run has converged if its median bearing error on the validation split is at most this share of that of
#: the constant camera in the middle of the training distribution.
CONVERGED_BELOW_CONSTANT = 0.8


def calibration_converged(bearing_deg: float, constant_bearing_deg: float) -> bool:
    """Whether a trained calibration network learnt at all: ``error <= 0.8 x`` that of the constant camera.

    >>> calibration_converged(7.9, constant_bearing_deg=10.0), calibration_converged(8.1, constant_bearing_deg=10.0)
    (True, False)
    """
    return bearing_deg <= CONVERGED_BELOW_CONSTANT * constant_bearing_deg


#: A camera fails on an image if its bearings are off by more than this on average, in degrees: the largest threshold of
#: AUC@1/5/10, by which cameras are compared, and less than the median error of a constant camera in the town (14°).
CALIBRATION_FAILURE_DEG = 10.0

#: A run of place recognition has converged if its recall@1 on the validation split is at least this many times chance.
CONVERGED_TIMES_CHANCE = 3.0


def places_converged(recall_at_1: float, chance: float) -> bool:
    """Whether a trained descriptor learnt at all: ``recall@1 >= min(3 chance, (1 + chance) / 2)``.

    >>> places_converged(0.04, chance=0.01), places_converged(0.7, chance=0.5)  # from 0.03 on, and from 0.75 on
    (True, False)
    """
    return recall_at_1 >= min(CONVERGED_TIMES_CHANCE * chance, (1 + chance) / 2)


@dataclass(frozen=True)
class LocalizationProtocol:
    """The definition of successful localization, and the terms of every table about localization.

    ======================= ===========================================================================================
    within (at a frame)     position error ``<= position`` and heading error ``<= heading_deg``
    converged at t          the first t such that the frames t .. t + ``frames`` - 1 are all within
    success (of a run)      converged at some t within the drive, or at some t <= a stated horizon
    recovered (kidnap at k) converged at some t with k <= t <= k + a stated horizon; the time it took is t - k
    tracking                share of the frames that are within, from the one where the run converged to the last
    lost                    the run never converged, or the estimated mode holds less than ``MODE_MASS`` of the weight
    ======================= ===========================================================================================

    A frame without an estimate, whose errors are nan, is not *within*.

    Attributes:
        position: largest position error: metres, or frames on a railway.
        heading_deg: largest heading error in degrees; None if there is no heading.
        frames: number of consecutive frames that must be within.
        unit: of ``position``.

    Raises:
        ValueError: a limit is not positive.

    Example:
        >>> LocalizationProtocol(position=0.5, heading_deg=10.0, frames=10).name("success")
        'success_0.5m_10deg_10f'
    """

    position: float
    heading_deg: float | None
    frames: int
    unit: Literal["m", "frames"] = "m"

    def __post_init__(self) -> None:
        limits = (self.position, self.frames, 1 if self.heading_deg is None else self.heading_deg)
        if not all(0 < limit < float("inf") for limit in limits):
            raise ValueError(f"the limits of a localization protocol must be positive and finite, got {self}")

    def name(self, metric: str) -> str:
        """A metric's name with its limits: ``success_0.5m_10deg_10f``."""
        heading = "" if self.heading_deg is None else f"_{self.heading_deg:g}deg"
        unit = "m" if self.unit == "m" else "frames"
        return f"{metric}_{self.position:g}{unit}{heading}_{self.frames}f"


#: One floor of an office, walked by a robot or a person.
OFFICE_LOCALIZATION = LocalizationProtocol(0.5, 10.0, 10)
#: Streets: the tightest of the limits commonly used under changing seasons (5 m), with heading.
TOWN_LOCALIZATION = LocalizationProtocol(5.0, 20.0, 10)
#: A railway, where a position is a frame of the reference traverse; one frame every ten seconds, about 230 m at full
#: speed.
NORDLAND_LOCALIZATION = LocalizationProtocol(2.0, None, 10, "frames")

#: A run whose estimated mode holds less of the weight than this is reported as lost.
MODE_MASS = 0.5
#: Frames after a kidnap within which a run must have converged again, to count as recovered.
RECOVERY_HORIZON = 60
#: A particle count is enough if at least this share of seeds succeed.
ENOUGH_SUCCESS = 0.95
