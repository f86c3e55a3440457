"""A user's photo: decoded from any common format, cropped for the network, and undistorted.

Pixels are those of the *upright original*: columns and rows after applying the EXIF orientation, from the top left
corner, with centres at + 0.5. A photo with more than 64 megapixels is decoded at a half, a third, ... of its size to
bound memory; all lengths are still in pixels of the original.
"""

from sextant.data.photos.exif import exif_focal_px
from sextant.data.photos.reading import photo_of_array, read_photo
from sextant.data.photos.straightening import Keep, Pinhole, straight_focal, through_pinhole, undistort_photo
from sextant.data.photos.view import NetworkView, Photo, network_view

__all__ = [
    "Keep",
    "NetworkView",
    "Photo",
    "Pinhole",
    "exif_focal_px",
    "network_view",
    "photo_of_array",
    "read_photo",
    "straight_focal",
    "through_pinhole",
    "undistort_photo",
]
