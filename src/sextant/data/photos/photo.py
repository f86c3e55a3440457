"""A decoded photo."""

from dataclasses import dataclass

from jaxtyping import UInt8
from numpy import ndarray


@dataclass(frozen=True)
class Photo:
    """A decoded photo.

    Attributes:
        image: upright RGB bytes, ``(h, w, 3)``; smaller than the original where that is very large.
        width: of the upright original, pixels.
        height: of the upright original, pixels.
        orientation: of the file by EXIF, 1 to 8; 1 is upright.
        exif_focal_px: focal length in pixels of the original by EXIF, or None.
        cropped: whether EXIF describes a picture of another shape, so that the lens's axis may be anywhere in this.
        gravity: by the accelerometer of the phone that took it: right, down and forward of the upright picture, of unit
            length; None where metadata tell none.
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
        """Pixels of :attr:`image` for one of the original; 1 unless the photo is very large."""
        rows, columns = self.image.shape[:2]
        return float(max(rows / self.height, columns / self.width))
