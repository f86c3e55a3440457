"""Pictures for a page: small, and in the page itself."""

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.photos import read_photo

#: pixels of the longest side of what a page shows
LONGEST = 1000


def page_picture(path: Path) -> dict[str, Any]:
    """A photo of any kind as a page can show it: upright and small.

    Raises:
        UserError: as :func:`~sextant.data.photos.read_photo`.
    """
    photo = read_photo(path)
    return {"picture": data_address(shrunk(photo.image)), "width": photo.width, "height": photo.height}


def shrunk(image: UInt8[ndarray, "h w 3"], longest: int = LONGEST) -> UInt8[ndarray, "h w 3"]:
    """An image whose longest side has at most ``longest`` pixels."""
    picture = Image.fromarray(image)
    picture.thumbnail((longest, longest), Image.Resampling.BOX)
    return np.asarray(picture)


def data_address(image: UInt8[ndarray, "h w *c"]) -> str:
    """An image as a ``data:`` address: WebP where it is transparent, PNG where it is grey, JPEG of all others."""
    kind = {4: "webp", 3: "jpeg"}.get(image.shape[2] if image.ndim == 3 else 1, "png")
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, kind, **({} if kind == "png" else {"quality": 88}))
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode()}"
