"""Images with poses from another program: COLMAP, OpenSfM or nerfstudio.

Whatever a format stores, a pose here is ``world_from_camera``, 4x4, of a camera whose x points right, y down and z
forward, and images are in the natural order of their names. Lengths are in the unit of the file, which is metres only
if that program knew the scale.
"""

from sextant.data.reconstructions.reading import NAMED_FORMATS, NamedFormat, named_format, read_reconstruction
from sextant.data.reconstructions.reconstruction import Lens, PosedImage, Reconstruction, reconstruction_of

__all__ = [
    "NAMED_FORMATS",
    "Lens",
    "NamedFormat",
    "PosedImage",
    "Reconstruction",
    "named_format",
    "read_reconstruction",
    "reconstruction_of",
]
