"""Drives to localize: a map of images at known poses, and the images and odometry of other drives."""

from sextant.chapters.localization.data.drive import Drive, LocalizationData, ProtocolName, motions_along
from sextant.chapters.localization.data.odometry_file import read_odometry
from sextant.chapters.localization.data.pose_folder import PoseFolder
from sextant.chapters.localization.data.simulated import DriveSettings
from sextant.chapters.localization.data.source import LocalizationSource, as_localization_source

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
