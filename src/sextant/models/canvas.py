r"""Pictures on square canvases as network inputs: with no more detail than the training images, and grey around them.

The picture is low-passed by a Gaussian that leaves a tenth of a wave of ``lines`` / 2 periods per side,
:math:`\sigma = \frac{\sqrt{2 \ln 10}}{\pi} \frac{N}{\text{lines}}` pixels of N. Otherwise a network would infer the
lens from sharpness: training crops of long lenses are enlarged, photos never are. Near the picture's border the mean is
over its own pixels only, so that nothing from outside leaks in.
"""

import math
from collections.abc import Iterator
from itertools import chain

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.geometry.canvas import picture_size


def low_pass_sigma(side: int, lines: float) -> float:
    """Standard deviation in pixels of the Gaussian that leaves ``lines`` of ``side``."""
    return math.sqrt(2 * math.log(10)) / math.pi * side / lines


def pictures_on_canvas(
    images: Float[Tensor, "b c n n"], aspect: Float[Tensor, "b"], lines: float
) -> Float[Tensor, "b c n n"]:
    """Squares with low-passed pictures of these aspects in their middles, and 0 around them."""
    side = images.shape[-1]
    sizes = [picture_size(side, shape) for shape in aspect.tolist()]
    means = {count: _means(side, count, low_pass_sigma(side, lines)).to(images) for count in set(chain(*sizes))}
    across, down = (torch.stack([means[count] for count in counts])[:, None] for counts in zip(*sizes, strict=True))
    with torch.autocast(images.device.type, enabled=False):  # in half precision, steps would show
        return down @ images @ across.mT


def pictures_of_canvas(
    images: Float[Tensor, "b c n n"], aspect: Float[Tensor, "b"], lines: float
) -> Iterator[Float[Tensor, "1 c _ _"]]:
    """The same pictures one by one, without their margins."""
    side = images.shape[-1]
    for image, shape in zip(pictures_on_canvas(images, aspect, lines), aspect.tolist(), strict=True):
        columns, rows = picture_size(side, shape)
        left, top = (side - columns) // 2, (side - rows) // 2
        yield image[None, :, top : top + rows, left : left + columns]


def _means(side: int, count: int, sigma: float) -> Float[Tensor, "n n"]:
    """Weights of the means that give the ``count`` middle pixels of a line of ``side``; the others are 0."""
    place = torch.arange(side) + 0.5 - side / 2
    inside = (place.abs() < count / 2).double()
    weights = torch.exp(-0.5 * ((place[:, None] - place) / sigma).square()).double() * inside
    return (weights / weights.sum(1, keepdim=True).clamp(min=1e-9) * inside[:, None]).float()
