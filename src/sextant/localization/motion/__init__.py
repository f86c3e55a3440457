"""Motion models: where a robot may be after the motion that odometry reports."""

from sextant.localization.motion.exponential import ExponentialMotion
from sextant.localization.motion.identity import IdentityMotion
from sextant.localization.motion.model import MotionModel
from sextant.localization.motion.odometry import OdometryMotion

__all__ = ["ExponentialMotion", "IdentityMotion", "MotionModel", "OdometryMotion"]
