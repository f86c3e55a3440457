"""Panoramas at halved resolutions, with a border that makes sampling across the seam and over the poles simple.

A level is padded by one pixel on all sides: columns wrap around the panorama, and the row beyond a pole is the row next
to it, shifted by half a turn. A fourth channel, without meaning, is added because OpenCV samples four channels 2.6
times as fast as three.
"""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

SMALLEST = 8  # rows of the coarsest level
Value = TypeVar("Value")


def padded(panorama: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h+2 w+2 4"]:
    """A panorama with one more pixel on every side, and four channels."""
    import cv2

    half = panorama.shape[1] // 2
    out = cv2.copyMakeBorder(cv2.cvtColor(panorama, cv2.COLOR_RGB2RGBA), 1, 1, 1, 1, cv2.BORDER_WRAP)
    out[0, 1:-1], out[-1, 1:-1] = (np.roll(out[row, 1:-1], half, axis=0) for row in (1, -2))
    out[:, 0], out[:, -1] = out[:, -2], out[:, 1]
    return np.asarray(out)


def halved(panorama: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h/2 w/2 3"]:
    """Halve a panorama: each pixel is the mean of the four that it covers, or of its area if the size is odd."""
    import cv2

    height, width = panorama.shape[:2]
    return np.asarray(cv2.resize(panorama, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA))


def top_level(height: int) -> int:
    """Number of the coarsest level of a panorama of ``height`` rows; 0 is the panorama itself."""
    return max(0, (height // SMALLEST).bit_length() - 1)


class Kept(Generic[Value]):
    """A cache of values by key that drops the least recently used ones beyond a number of bytes.

    Args:
        most_bytes: of all values.
        size: bytes of a value.
    """

    def __init__(self, most_bytes: int, size: Callable[[Value], int]):
        self.most_bytes, self._size = most_bytes, size
        self._values: OrderedDict[object, Value] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()

    def get(self, key: object, make: Callable[[], Value]) -> Value:
        """The value of a key, made if it is not cached."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        with self._lock:
            if key not in self._values:
                self._values[key] = value
                self._bytes += self._size(value)
            while self._bytes > self.most_bytes and len(self._values) > 1:
                _, oldest = self._values.popitem(last=False)
                self._bytes -= self._size(oldest)
        return value

    def __reduce__(self) -> tuple[type["Kept[Value]"], tuple[int, Callable[[Value], int]]]:
        return type(self), (self.most_bytes, self._size)  # another process makes its own
