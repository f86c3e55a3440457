"""Weather: snow, frost, fog, sunlight, spatter, and the textures they are made from."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numpy.typing import NDArray
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.corruption import filled
from sextant.corruptions.filtering import clipped_zoom, gaussian_filter, motion_blur
from sextant.corruptions.pixels import eight_bit, luma
from sextant.corruptions.textures import HEIGHT, KINDS, WIDTH, frost_texture, map_side, plasma


@dataclass(frozen=True)
class Brightness(BenchmarkCorruption[float, None]):
    r"""``V' = clip(V + c)`` in HSV; for a grey image, ``y = clip(x + c)``.

    With hue and saturation kept, adding c to :math:`V = \max(r, g, b)` multiplies every channel by :math:`\min(V + c,
    1) / V`; a black pixel, which has no hue and no saturation, becomes grey. So no conversion is needed.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> colour = torch.tensor([0.4, 0.2, 0.1]).view(1, 3, 1, 1)
    >>> Brightness((0.2,), "brightness")(colour, level=1, indices=[0], seed=0).flatten()  # the hue stays
    tensor([0.6000, 0.3000, 0.1500])

    Args:
        table: c for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Raise the value, keeping hue and saturation."""
        work = images.to(torch.promote_types(images.dtype, torch.float32))  # half precision has no 1e-12
        value = work.amax(1, keepdim=True)
        raised = (value + self.row(level)).clamp(0, 1)
        bright = torch.where(value > 0, work * (raised / value.clamp(min=1e-12)), raised)
        return bright.clamp(0, 1).to(images.dtype)


MAP_POINTS = 2**21  # points of the maps that are in memory at once


@dataclass(frozen=True)
class Fog(BenchmarkCorruption[tuple[float, float], Tensor]):
    """``y = (x + c·P) · m / (m + c)`` with ``m = max x`` over the image and ``P`` a plasma fractal in [0, 1].

    Every channel gets the same fog, and a black image stays black. The side of the map is the next power of two of the
    image's longer side, and its corner is used, as in CIFAR-10-C (32 for 32 pixels) and ImageNet-C (256 for 224).
    MNIST-C takes its 28 pixels from a map of 256, of which so small a corner is smooth: ``map_size=256``.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> foggy = Fog(((1.5, 2.0),), "fog")(torch.eye(16)[None, None], level=1, indices=[0], seed=0)
    >>> foggy.mean() > 1 / 16, foggy.max() <= 1
    (tensor(True), tensor(True))

    Args:
        table: (c, decay of the plasma) for each severity.
        map_size: side of the map, a power of two; None, or less than the image, takes the smallest that covers it.
    """

    map_size: int | None = None

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float[Tensor, "b n n"]:
        """The perturbation of each point of the map, uniform in [-1, 1]."""
        side = max(map_side(*shape[-2:]), self.map_size or 0)
        streams = self.streams(level, indices, seed)
        return filled((side, side), streams, lambda one, stream: one.uniform_(-1, 1, generator=stream))

    def apply(self, images: Images, level: float, params: Float[Tensor, "b n n"]) -> Images:
        """Add the fog and rescale."""
        amount, decay = self.row(level)
        size = (images.shape[-2], images.shape[-1])
        at_once = max(1, MAP_POINTS // params[0].numel())
        maps = [plasma(part.to(images.device), decay, size) for part in params.split(at_once)]
        fog = torch.cat(maps)[:, None].to(images)
        brightest = images.amax((1, 2, 3), keepdim=True)
        return ((images + amount * fog) * brightest / (brightest + amount)).clamp(0, 1)


ANGLES = (-135.0, -45.0)


class SnowDraw(NamedTuple):
    """Standard normal noise from which the flakes are made, and the wind's angle in degrees."""

    noise: Float[Tensor, "b h w"]
    angles: Float64[Tensor, "b"]


class SnowRow(NamedTuple):
    """One severity: mean, spread, zoom and threshold of flakes, radius and sigma of their blur, the image's share."""

    mean: float
    spread: float
    zoom: float
    threshold: float
    radius: float
    sigma: float
    mix: float


@dataclass(frozen=True)
class Snow(BenchmarkCorruption[tuple[float, ...], SnowDraw]):
    """``y = w + s + rot180(s)`` with ``w = mix·x + (1 - mix)·max(x, 1.5·luma(x) + 0.5)``, clipped to [0, 1].

    The flakes ``s`` are normal noise, zoomed about the centre, set to 0 below a threshold, clipped to [0, 1] and
    blurred along the wind, whose angle is uniform in [-135°, -45°]; turned by 180° they fall a second time.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> row = SnowRow(mean=0.1, spread=0.3, zoom=2, threshold=0.5, radius=4, sigma=2, mix=0.8)
    >>> snowy = Snow((row,), "snow")(torch.zeros(1, 3, 32, 32), level=1, indices=[0], seed=0)
    >>> snowy.min()  # 0.2 · 0.5: where there is no flake the image is whitened all the same
    tensor(0.1000)

    Args:
        table: the values of :class:`SnowRow` for each severity.
        mode: ``faithful`` holds the flakes in 8 bits before the blur (rounded down) and after it (rounded), as the
            benchmark does by way of PNG files; ``corrected`` does not round them.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> SnowDraw:
        """Noise and wind."""
        noise = torch.empty(len(indices), *shape[-2:], dtype=torch.float32)
        angles = torch.empty(len(indices), dtype=torch.float64)
        for i, generator in enumerate(self.streams(level, indices, seed)):
            noise[i].normal_(generator=generator)
            angles[i].uniform_(*ANGLES, generator=generator)
        return SnowDraw(noise, angles)

    def apply(self, images: Images, level: float, params: SnowDraw) -> Images:
        """Whiten the image and let the drawn flakes fall."""
        row = SnowRow(*self.row(level))
        flakes = clipped_zoom(params.noise[:, None].to(images) * row.spread + row.mean, row.zoom)
        flakes = flakes.where(flakes >= row.threshold, 0).clamp(0, 1)
        if self.mode == "faithful":
            flakes = eight_bit(flakes, "faithful")
        flakes = motion_blur(flakes, row.radius, row.sigma, params.angles)
        if self.mode == "faithful":
            flakes = eight_bit(flakes, "corrected")  # ImageMagick rounds to the nearest
        whiter = row.mix * images + (1 - row.mix) * torch.maximum(images, 1.5 * luma(images) + 0.5)
        return (whiter + flakes + flakes.flip(-2, -1)).clamp(0, 1)


class FrostDraw(NamedTuple):
    """The texture that each image gets, and the corner of its crop."""

    kinds: Int64[Tensor, "b"]
    tops: Int64[Tensor, "b"]
    lefts: Int64[Tensor, "b"]


@dataclass(frozen=True)
class Frost(BenchmarkCorruption[tuple[float, float], FrostDraw]):
    """``y = a·x + b·frost``, clipped to [0, 1], with a random crop of one of five textures of ice.

    The textures are drawn here (:mod:`sextant.corruptions.textures`), because the authors' photographs
    may not be redistributed. So an error under frost is *not comparable* with one on the published files. Images of one
    channel get the luma of the frost.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> drawn = Frost(((0.8, 0.4),), "frost", shrink=0.2).draw(1, torch.arange(100), (3, 32, 32), seed=0)
    >>> drawn.kinds.unique(), drawn.tops.max() <= 154 - 32  # cut-outs of 154x205 pixels
    (tensor([0, 1, 2, 3, 4]), tensor(True))

    Args:
        table: (a, b) for each severity.
        shrink: size of the textures, 1 for 768x1024 pixels as for ImageNet-C; CIFAR-10-C has 0.2, bilinear without
            smoothing. Textures are enlarged where needed to exceed the image by one pixel.
    """

    shrink: float = 1.0

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> FrostDraw:
        """Texture and place, each equally likely."""
        height, width = shape[-2:]
        full_height, full_width = self._size(height, width)
        draws = [
            [
                int(torch.randint(limit, (), generator=stream))
                for limit in (len(KINDS), full_height - height, full_width - width)
            ]
            for stream in self.streams(level, indices, seed)
        ]
        return FrostDraw(*torch.tensor(draws, dtype=torch.int64).reshape(-1, 3).unbind(-1))

    def apply(self, images: Images, level: float, params: FrostDraw) -> Images:
        """Lay the drawn frost over the images."""
        share, strength = self.row(level)
        height, width = images.shape[-2:]
        size = self._size(height, width)
        places = zip(*(part.tolist() for part in params), strict=True)
        frost = [_texture(kind, *size)[:, top : top + height, left : left + width] for kind, top, left in places]
        ice = torch.stack(frost).to(images)
        return (share * images + strength * (luma(ice) if images.shape[1] == 1 else ice)).clamp(0, 1)

    def _size(self, height: int, width: int) -> tuple[int, int]:
        """Height and width of the textures for images of ``height`` and ``width``."""
        factor = max(self.shrink, (height + 1) / HEIGHT, (width + 1) / WIDTH)
        return max(round(HEIGHT * factor), height + 1), max(round(WIDTH * factor), width + 1)


@lru_cache(maxsize=2 * len(KINDS))
def _texture(kind: int, height: int, width: int) -> Float[Tensor, "3 h w"]:
    resized = cv2.resize(frost_texture(kind), (width, height), interpolation=cv2.INTER_LINEAR)
    return torch.from_numpy(np.ascontiguousarray(resized.transpose(2, 0, 1)))


WATER = (175 / 255, 238 / 255, 238 / 255)  # pale turquoise
MUD = (63 / 255, 42 / 255, 20 / 255)  # brown
GREY_MUD = (63 / 255,)
RELIEF = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], np.float32)  # lit from one corner
REACH = 20  # pixels from an edge at which the distance saturates


class SpatterRow(NamedTuple):
    """One severity: mean, spread, smoothing, threshold of the liquid; strength (water) or blur (mud); whether mud."""

    mean: float
    spread: float
    sigma: float
    threshold: float
    strength: float
    mud: float


@dataclass(frozen=True)
class Spatter(BenchmarkCorruption[tuple[float, ...], Tensor]):
    """``y = x + m·water``, or ``y = (1 - m)·x + m·mud``, clipped to [0, 1].

    The liquid is smoothed normal noise, set to 0 below a threshold. Mud covers where there is liquid: ``m`` is that
    mask, smoothed and set to 0 below 0.8. Water shines by the relief of the distances to the liquid's edges (Canny),
    times the liquid, with its maximum scaled to the row's strength. An image of one channel gets mud at every severity,
    in the grey of MNIST-C, whose authors have no water.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> row = SpatterRow(mean=0.65, spread=0.3, sigma=2, threshold=0.65, strength=0.5, mud=1)
    >>> muddy = Spatter((row,), "spatter")(torch.ones(1, 3, 32, 32), level=1, indices=[0], seed=0)
    >>> muddy.amin((0, 2, 3)) * 255  # brown
    tensor([63., 42., 20.])

    Args:
        table: the values of :class:`SpatterRow` for each severity.
        mode: the modes differ only for liquid above 1: ``faithful`` lets it overflow its 8 bits as the benchmark does
            (in its tables this does not occur in practice), ``corrected`` saturates it. Both leave an image without a
            drop as it is; the benchmark divides 0 by 0 there.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float[Tensor, "b h w"]:
        """Standard normal noise from which the liquid is made."""
        streams = self.streams(level, indices, seed)
        return filled(shape[-2:], streams, lambda one, stream: one.normal_(generator=stream))

    def apply(self, images: Images, level: float, params: Float[Tensor, "b h w"]) -> Images:
        """Cover the images with the drawn water or mud."""
        row, grey = SpatterRow(*self.row(level)), images.shape[1] == 1
        liquid = gaussian_filter(params.double().to(images.device)[:, None] * row.spread + row.mean, row.sigma)
        liquid = liquid.where(liquid >= row.threshold, 0)
        if grey or row.mud:
            cover = gaussian_filter((liquid > row.threshold).double(), row.strength)
            cover = cover.where(cover >= 0.8, 0).to(images)
            return (images * (1 - cover) + _colour(images, GREY_MUD if grey else MUD) * cover).clamp(0, 1)
        shine = self._shine(liquid[:, 0]).to(images)[:, None]
        return (images + row.strength * shine * _colour(images, WATER)).clamp(0, 1)

    def _shine(self, liquid: Float64[Tensor, "b h w"]) -> Float[Tensor, "b h w"]:
        levels = (liquid * 255).long()
        levels = levels & 255 if self.mode == "faithful" else levels.clamp(max=255)
        return torch.from_numpy(np.stack([_shine(one) for one in levels.to(torch.uint8).cpu().numpy()]))


def _shine(liquid: NDArray[np.uint8]) -> NDArray[np.float32]:
    """How bright one image's water is, its maximum 1: liquid times the relief of the distance to its edges."""
    distance = cv2.distanceTransform(255 - cv2.Canny(liquid, 50, 150), cv2.DIST_L2, 5)
    near = cv2.blur(np.minimum(distance, REACH), (3, 3)).astype(np.uint8)
    relief = cv2.blur(cv2.filter2D(cv2.equalizeHist(near), cv2.CV_8U, RELIEF), (3, 3))
    shine: NDArray[np.float32] = np.multiply(liquid, relief, dtype=np.float32)
    shine /= max(shine.max(), 1)  # without a drop no shine; with one, a product of whole numbers is at least 1
    return shine


def _colour(images: Images, colour: tuple[float, ...]) -> Float[Tensor, "1 c 1 1"]:
    return images.new_tensor(colour)[None, :, None, None]
