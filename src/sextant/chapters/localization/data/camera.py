"""A camera of this machine: its live images, until it is disconnected or the user stops."""

import re
import time
from collections.abc import Iterator
from threading import Condition, Thread
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.image_files import picture_bytes
from sextant.data.videos import Frame, Size, silent_opencv
from sextant.errors import UserError

PREFIX = "camera:"


class Camera:
    """Always yields the newest image; images that arrive while one is being localized are dropped.

    Args:
        number: of the camera, from 0.
        every: take every k-th image.
    """

    def __init__(self, number: int, every: int = 1):
        self.number, self.every = number, every
        self._taken: list[float] = []

    @property
    def times_s(self) -> Float64[ndarray, "n"]:
        """Times of the images taken so far, in seconds since the first."""
        return np.array(self._taken) - (self._taken[0] if self._taken else 0.0)

    def read(self, size: Size | None) -> Iterator[Frame]:
        """Yield the newest image each time, stretched to a size or as it is, until the camera stops.

        Raises:
            UserError: the camera cannot be opened, or delivers no image.
        """
        import cv2

        with silent_opencv():
            device = cv2.VideoCapture(self.number)
        if not device.isOpened():
            device.release()
            raise UserError(
                f"input={PREFIX}{self.number} cannot be opened",
                "Check which cameras exist (ls /dev/video*), and whether another program is using this one.",
            )
        newest = _Newest(device, self.every)
        try:
            self._taken.clear()
            while (found := newest.next()) is not None:
                taken, pixels = found
                self._taken.append(taken)
                picture = Image.fromarray(np.ascontiguousarray(pixels[..., ::-1]))
                shape = size or (picture.height, picture.width, 3)
                yield Frame(f"image {len(self._taken) - 1}", picture_bytes(picture, *shape))
            if not self._taken:
                raise UserError(f"input={PREFIX}{self.number} delivers no image", "Try another: camera:1")
        finally:
            newest.end()
            device.release()


class _Newest:
    """Reads a device as fast as it delivers images, and returns the latest one."""

    def __init__(self, device: Any, every: int):
        self._device, self._every = device, every
        self._changed, self._ended = Condition(), False
        self._image: tuple[float, ndarray] | None = None
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        count = 0
        while not self._ended:
            fine, pixels = self._device.read()
            with self._changed:
                if not fine:
                    self._ended = True
                elif count % self._every == 0:
                    self._image = time.monotonic(), pixels
                self._changed.notify()
            count += 1

    def next(self) -> tuple[float, UInt8[ndarray, "h w 3"]] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._image is not None or self._ended)
            found, self._image = self._image, None
            return found

    def end(self) -> None:
        self._ended = True
        self._thread.join()


def find_camera(given: str, every: int) -> Camera | None:
    """The camera that ``input=camera:0`` names; None if it names something else.

    Raises:
        UserError: what follows ``camera:`` is not a number.
    """
    if not given.startswith(PREFIX):
        return None
    if not re.fullmatch(r"\d{1,3}", number := given.removeprefix(PREFIX)):
        raise UserError(f"input={given}: a camera is given by its number, from 0", f"input={PREFIX}0")
    return Camera(int(number), every)
