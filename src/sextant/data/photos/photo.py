"""A decoded photo."""

from dataclasses import dataclass

from jaxtyping import UInt8
from numpy import ndarray


@dataclass(frozen=True)
class Photo:
    """A decoded photo.

    Attributes:
        image: upright RGB bytes, ``(h, w, 3)``; smaller than the original if that is very large.
        width: of the upright original, pixels.
        height: of the upright original, pixels.
        orientation: EXIF orientation of the file, 1 to 8; 1 is upright.
        exif_focal_px: focal length from EXIF in pixels of the original, or None.
        cropped: whether EXIF describes a picture of a different shape, so that the optical axis may be anywhere in this
            one.
        gravity: from the phone's accelerometer: right, down and forward in the upright picture, of unit length; None if
            the metadata do not tell.
    """

    image: UInt8[ndarray, "h w 3"]
    width: int
    height: int
    orientation: int
    exif_focal_px: float | None
    cropped: bool = False
    gravity: tuple[float, float, float] | None = None

    @property
    def scale(self) -> float:
        """Pixels of :attr:`image` per pixel of the original; 1 unless the photo is very large."""
        rows, columns = self.image.shape[:2]
        return float(max(rows / self.height, columns / self.width))
