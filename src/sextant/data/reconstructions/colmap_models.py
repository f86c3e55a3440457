"""The camera models of COLMAP: their numbers, names and parameters.

Source: COLMAP 4.2, ``src/colmap/sensor/models.h``; the first parameter is a focal length in pixels, except for a
panorama (EQUIRECTANGULAR), whose parameters are its sides.
"""

from sextant.data.reconstructions.reconstruction import Lens

#: number in binary files -> name and number of parameters
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}


def lens_of(model: str, width: int, height: int, first: float) -> Lens:
    """The lens of a camera, whose first parameter is ``first``."""
    return Lens(model, width, height, None if model == "EQUIRECTANGULAR" else first)
