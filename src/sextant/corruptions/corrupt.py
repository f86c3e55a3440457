"""One call to corrupt an array, a tensor or a Pillow image, or a batch of them."""

import difflib
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Shaped
from PIL import Image
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.benchmark_suite import SETS, benchmark_set
from sextant.corruptions.contract import CHANNELS
from sextant.corruptions.pixels import to_bytes
from sextant.errors import UserError

Kind = TypeVar("Kind")
KINDS = (
    "Bytes are (h, w), (h, w, c) or (n, h, w, c), floating-point values in [0, 1] (h, w), (c, h, w) or (n, c, h, w), "
    "with c of 1 or 3; Pillow images are of mode L or RGB."
)


def corrupt(
    image: Kind, name: str, severity: int, seed: int = 0, *, set: str = "imagenet_c", mode: Mode = "faithful"
) -> Kind:
    """Apply a corruption of a published set to ``image``, and return it in the form it was given in.

    The draw depends only on the seed, the corruption, the severity and the position in the batch: image i of a batch
    has position i, a single image has position 0. So *two images that are passed one by one with one seed get the same
    noise*; pass them as a batch, or give each its own seed.

    >>> corrupt(np.full((32, 32, 3), 128, np.uint8), "fog", severity=3).shape
    (32, 32, 3)
    >>> corrupt(torch.rand(8, 3, 64, 64), "gaussian_noise", 5).dtype
    torch.float32

    Args:
        image: one image or a batch, with one or three channels: a NumPy array or a tensor of bytes ``(h, w)``,
            ``(h, w, c)`` or ``(n, h, w, c)``, or of floating-point values in [0, 1] ``(h, w)``, ``(c, h, w)`` or
            ``(n, c, h, w)``; or a Pillow image of mode ``L`` or ``RGB``.
        name: name of the corruption, such as ``fog``; ``list(imagenet_c())`` gives them all.
        severity: 1 to 5; 1 for a corruption with a single severity.
        seed: seed of all random draws.
        set: set of parameters: ``imagenet_c``, meant for 224x224 pixels, ``cifar10_c`` for 32x32, ``mnist_c`` for
            28x28.
        mode: ``faithful`` to the authors' code, errors included, or ``corrected``; bytes are rounded accordingly
            (:mod:`.eight_bit`).

    Returns:
        The corrupted image, with the type, shape and data type of ``image``, which is not changed.

    Raises:
        UserError: the set has no such corruption or severity, or the image is of none of these kinds.
        ValueError: an elastic transform of an image smaller than 3x3 pixels.
    """
    corruption = _corruption(name, severity, set, mode)
    values = _tensor(image)
    whole = values.dtype == torch.uint8
    batch = _batch(values, channels_last=whole)
    result = corruption(batch.float() / 255 if whole else batch, severity, torch.arange(len(batch)), seed)
    if whole:
        result = to_bytes(result, mode).movedim(1, -1)
    result = result.reshape(values.shape).contiguous()
    if isinstance(image, Tensor):
        return result  # type: ignore[return-value]
    array = result.numpy()
    return Image.fromarray(array) if isinstance(image, Image.Image) else array  # type: ignore[return-value]


def _corruption(name: str, severity: int, set: str, mode: Mode) -> BenchmarkCorruption[Any, Any]:
    families = benchmark_set(set).families
    if name not in families:
        elsewhere = [key for key, other in SETS.items() if name in other.families]
        like = difflib.get_close_matches(
            str(name).lower().replace(" ", "_").replace("-", "_"), families, n=3, cutoff=0.5
        )
        hints = [f"It is in {elsewhere[0]}: pass set={elsewhere[0]!r}."] if elsewhere else []
        hints += [f"Did you mean {' or '.join(like)}?"] if like else []
        raise UserError(
            f"name={name!r} is not a corruption of {set}", " ".join([*hints, f"It has {', '.join(families)}."])
        )
    corruption = SETS[set].build([name], mode=mode)[name]
    try:
        corruption.row(severity)
    except ValueError as error:
        raise UserError(f"severity={severity!r}: {error}") from None
    return corruption


def _tensor(image: object) -> Shaped[Tensor, "..."]:
    if isinstance(image, Tensor):
        values = image
    elif isinstance(image, np.ndarray) and image.dtype.kind in "uf" and image.dtype.itemsize <= 8:
        # a copy: the array may be read-only, run backwards, or have its bytes in another order
        values = torch.from_numpy(np.array(image, image.dtype.newbyteorder("="), order="C"))
    elif isinstance(image, Image.Image) and image.mode in ("L", "RGB"):
        values = torch.from_numpy(np.array(image))
    elif isinstance(image, Image.Image):
        raise UserError(f"the image is of mode {image.mode}", f"image.convert('RGB'). {KINDS}")
    else:
        held = f" of {image.dtype}" if isinstance(image, np.ndarray) else ""
        raise UserError(f"the image is a {type(image).__name__}{held}", KINDS)
    if values.dtype != torch.uint8 and not values.is_floating_point():
        raise UserError(f"the image holds {values.dtype}", KINDS)
    return values


def _batch(values: Shaped[Tensor, "..."], *, channels_last: bool) -> Shaped[Tensor, "n c h w"]:
    shape = tuple(values.shape)
    if len(shape) not in (2, 3, 4) or (len(shape) > 2 and shape[-1 if channels_last else -3] not in CHANNELS):
        there, where = ("last", -3) if channels_last else ("before height and width", -1)
        moved = len(shape) in (3, 4) and shape[where] in CHANNELS
        problem = f"the image is {values.dtype} of the shape {shape}"
        raise UserError(problem, f"Move its channels: there they come {there}. {KINDS}" if moved else KINDS)
    if len(shape) == 2:
        return values[None, None]
    batch = values if len(shape) == 4 else values[None]
    return batch.movedim(-1, 1) if channels_last else batch
