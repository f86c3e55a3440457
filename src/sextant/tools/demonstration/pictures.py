"""Pictures for a page: small, and embedded in the page."""

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from sextant.data.photos import read_photo

#: longest side of what a page shows, in pixels
LONGEST = 1000


def page_picture(path: Path) -> dict[str, Any]:
    """A photo of any kind in a form that a page can show: upright and small.

    Raises:
        UserError: as for :func:`~sextant.data.photos.read_photo`.
    """
    photo = read_photo(path)
    return {"picture": data_address(shrunk(photo.image)), "width": photo.width, "height": photo.height}


def shrunk(image: UInt8[ndarray, "h w 3"], longest: int = LONGEST) -> UInt8[ndarray, "h w 3"]:
    """An image whose longest side has at most ``longest`` pixels."""
    picture = Image.fromarray(image)
    picture.thumbnail((longest, longest), Image.Resampling.BOX)
    return np.asarray(picture)


def data_address(image: UInt8[ndarray, "h w *c"]) -> str:
    """An image as a ``data:`` address: WebP if it is transparent, PNG if it is grey, otherwise JPEG."""
    kind = {4: "webp", 3: "jpeg"}.get(image.shape[2] if image.ndim == 3 else 1, "png")
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, kind, **({} if kind == "png" else {"quality": 88}))
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode()}"
