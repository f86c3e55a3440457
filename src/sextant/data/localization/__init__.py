"""Drives to localize: a map of images at known poses, and the images and odometry of other drives."""

from sextant.data.localization.drive import Drive
from sextant.data.localization.drive_settings import DriveSettings
from sextant.data.localization.localization_data import LocalizationData, ProtocolName
from sextant.data.localization.motions import motions_along
from sextant.data.localization.odometry_file import read_odometry
from sextant.data.localization.pose_folder import PoseFolder
from sextant.data.localization.source import LocalizationSource, as_localization_source

__all__ = [
    "Drive",
    "DriveSettings",
    "LocalizationData",
    "LocalizationSource",
    "PoseFolder",
    "ProtocolName",
    "as_localization_source",
    "motions_along",
    "read_odometry",
]
