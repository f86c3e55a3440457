r"""Random sharpness, sharpening and compression of training crops, drawn independently of the camera.

Crops of a panorama show more detail the wider the lens, since a long lens enlarges a few of its pixels. A photo is
sharp whatever the lens. So that a network cannot read the lens off the sharpness, every training crop is reduced to a
number of lines per side that is drawn log-uniformly. Half of the crops are blurred by a Gaussian. The others are made
smaller, by area averages or bicubic interpolation, and enlarged again, by linear or bicubic interpolation. Then a third
of the crops are sharpened by an unsharp mask, and a third are compressed by JPEG at a quality of 50 to 95.

What a crop gets is a function of (seed, number of the crop) alone.
"""

import cv2
import numpy as np
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray

from sextant.data.counters import uniforms

#: standard deviation, in widths of a line, of the Gaussian that leaves a tenth of the finest wave
SIGMA = np.sqrt(2 * np.log(10)) / np.pi
SHRINKING, ENLARGING = (cv2.INTER_AREA, cv2.INTER_CUBIC), (cv2.INTER_LINEAR, cv2.INTER_CUBIC)
SHARPENED, COMPRESSED = 1 / 3, 1 / 3
QUALITY = (50, 95)


def with_detail(
    images: UInt8[ndarray, "b 3 h w"], lines: tuple[float, float], numbers: Int64[ndarray, "b"], seed: int
) -> UInt8[ndarray, "b 3 h w"]:
    """Draw the detail of each crop; see the module.

    Args:
        images: crops.
        lines: fewest and most that are left per side.
        numbers: of the crops.
        seed: of the draws.
    """
    u = uniforms(numbers % 2**32, numbers // 2**32, 0, seed ^ 0xDE7A11, 6)
    drawn = [_drawn(image.transpose(1, 2, 0), lines, each) for image, each in zip(images, u.T, strict=True)]
    return np.ascontiguousarray(np.stack(drawn).transpose(0, 3, 1, 2))


def _drawn(image: UInt8[ndarray, "h w 3"], lines: tuple[float, float], u: Float[ndarray, "6"]) -> ndarray:
    image = np.ascontiguousarray(image)
    height, width = image.shape[:2]
    left = min(float(lines[0] * (lines[1] / lines[0]) ** u[0]), float(width))  # more than all pixels: all of them
    share = left / width
    if u[1] < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), float(SIGMA / share) if share < 1 else 0.3)
    elif share < 1:
        which = int((u[1] - 0.5) * 8)
        small = (max(2, round(width * share)), max(2, round(height * share)))
        image = cv2.resize(image, small, interpolation=SHRINKING[which // 2])
        image = cv2.resize(image, (width, height), interpolation=ENLARGING[which % 2])
    if u[2] < SHARPENED:
        image = cv2.addWeighted(image, 1 + u[3], cv2.GaussianBlur(image, (0, 0), 1.2), -u[3], 0)
    if u[4] < COMPRESSED:
        quality = round(QUALITY[0] + (QUALITY[1] - QUALITY[0]) * u[5])
        coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
    return image
