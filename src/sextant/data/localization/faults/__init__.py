"""Faults of the robot, its camera, its wheels, or its map."""

from sextant.data.localization.faults.camera import Blackout, DroppedFrames
from sextant.data.localization.faults.fault import Fault, NoFault
from sextant.data.localization.faults.kidnap import Kidnap
from sextant.data.localization.faults.maps import NoisyMapPoses, ThinnedMap, WrongSeasonMap
from sextant.data.localization.faults.start import WrongStart
from sextant.data.localization.faults.wheels import MissingOdometry, OdometryScale, OdometrySlip

__all__ = [
    "Blackout",
    "DroppedFrames",
    "Fault",
    "Kidnap",
    "MissingOdometry",
    "NoFault",
    "NoisyMapPoses",
    "OdometryScale",
    "OdometrySlip",
    "ThinnedMap",
    "WrongSeasonMap",
    "WrongStart",
]
