"""Patch-normalised pixels, the image comparison of SeqSLAM."""

from jaxtyping import Float32
from numpy import ndarray

from sextant.baselines.descriptor import PlaceDescriptor
from sextant.baselines.pixels import standardised


class PatchNormalised(PlaceDescriptor):
    """``(x - mean_P(x)) / sd_P(x)`` in each square patch P of a grid: ``height * width`` values, patch by patch.

    SeqSLAM sums absolute differences; cosine similarity ranks alike on standardised values and needs one matrix
    product. Flat patches become zeros.

    Source: Milford and Wyeth 2012, "SeqSLAM", section III.

    Args:
        height, width: size in pixels at which the images are described; multiples of ``patch``.
        patch: side of a patch in pixels, at least 2.

    Example:
        >>> import numpy as np
        >>> image = np.arange(16, dtype=np.uint8).reshape(1, 4, 4, 1) * 9
        >>> brighter = image + np.uint8(50)
        >>> one, other = PatchNormalised(4, 4, patch=2).describe(np.concatenate([image, brighter]))
        >>> bool(np.allclose(one, other, atol=1e-4))  # brightness alone changes nothing
        True
    """

    def __init__(self, height: int = 32, width: int = 64, patch: int = 8):
        super().__init__(height, width)
        self.patch = patch

    def describe_grey(self, grey: Float32[ndarray, "n h w"]) -> Float32[ndarray, "n d"]:
        """Standardised patches, one after the other."""
        side = self.patch
        if side < 2 or self.height % side or self.width % side:
            raise ValueError(f"patch={side} must be at least 2 and divide height={self.height} and width={self.width}")
        blocks = grey.reshape(len(grey), self.height // side, side, self.width // side, side)
        patches = blocks.swapaxes(2, 3).reshape(len(grey), -1, side * side)  # (n, patches, side²)
        return standardised(patches).reshape(len(grey), -1)
