"""Banks: the maps that COSFIRE filters are built on, each the strength of a simple feature at every pixel."""

import math
from abc import ABC, abstractmethod
from typing import Annotated, Any, Literal

import torch
import torch.nn.functional as F
from annotated_types import Ge, Gt, Le, MinLen
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire.blur import Border, gaussian_line, padded, twice_convolved
from sextant.layers.cosfire.tolerance import Move
from sextant.layers.floating import require_floating
from sextant.ranges import Count, Positive, checked, fits


class Bank(nn.Module, ABC):
    """A family of non-negative response maps, each named by a row of P numbers: its *channel*.

    Attributes:
        learnable: whether maps are differentiable in the numbers of a channel.
    """

    learnable: bool = False

    @abstractmethod
    def grid(self) -> Float[Tensor, "k p"]:
        """The channels that :meth:`describe` returns."""

    @abstractmethod
    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """One non-negative map for each channel of the grid, from which filters are configured.

        Raises:
            UserError: the bank cannot take such images.
        """

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """The largest response of any channel of the grid in each image; thresholds are shares of it."""
        return self.describe(images).amax((1, 2, 3))

    def strength(self, maps: Float[Tensor, "b k y x"]) -> Float[Tensor, "b #k y x"]:
        """The strength that ``t1`` applies to when filters are configured: the responses themselves."""
        return maps

    @abstractmethod
    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u p"]) -> Float[Tensor, "b u y x"]:
        """One non-negative map for each of ``channels``."""

    def options(self) -> dict[str, Any]:
        """Arguments that rebuild the bank, as plain values; empty if it holds a network."""
        return {}


class SteerableBank(Bank):
    """A bank for which the channels of a moved image follow from those of the original.

    With other banks, the moved forms of a filter are configured from moved prototypes.
    """

    @abstractmethod
    def moved(self, channels: Float[Tensor, "n p"], move: Move) -> Float[Tensor, "n p"]:
        """The channels that respond to a moved image as ``channels`` do to the original."""


def check_grey(images: Tensor, name: str) -> None:
    """Raise a ``UserError`` unless the images are floating-point and have one channel."""
    require_floating(images)
    if images.shape[1] != 1:
        raise UserError(
            f"{name} takes grey images (b, 1, h, w), got {images.shape[1]} channels",
            "Average them: images.mean(1, keepdim=True).",
        )


def gabor_kernel(
    wavelength: float,
    theta_rad: float,
    *,
    phase_rad: float = math.pi,
    bandwidth: float = 2.0,
    aspect: float = 0.5,
) -> Float[Tensor, "s s"]:
    """One kernel, in float64; its side is ``2 ceil(2.5 sigma / aspect) + 1``.

    >>> gabor_kernel(8.0, 0.0).shape
    torch.Size([27, 27])

    Args:
        wavelength: λ, in pixels.
        theta_rad: θ, the direction across the bars, counter-clockwise from the x axis.
        phase_rad: φ: 0 for bright bars, π for dark ones, ±π/2 for edges.
        bandwidth: b, in octaves.
        aspect: γ, below 1 for kernels longer than wide.
    """
    octaves = 2.0**bandwidth
    sigma = wavelength / math.pi * math.sqrt(math.log(2) / 2) * (octaves + 1) / (octaves - 1)
    reach = math.ceil(2.5 * sigma / aspect)
    line = torch.arange(-reach, reach + 1, dtype=torch.float64)
    x, y = line[None, :], -line[:, None]
    u = x * math.cos(theta_rad) + y * math.sin(theta_rad)
    v = -x * math.sin(theta_rad) + y * math.cos(theta_rad)
    kernel = torch.exp(-(u**2 + (aspect * v) ** 2) / (2 * sigma**2)) * torch.cos(
        2 * math.pi * u / wavelength + phase_rad
    )
    bright, dark = kernel.clamp(min=0), kernel.clamp(max=0)
    return bright / bright.sum() - dark / dark.sum()


class GaborBank(SteerableBank):
    r"""Half-wave rectified Gabor responses; a channel is (λ in pixels, θ in rad).

    .. math:: g(x, y) = e^{-(u^2 + \gamma^2 v^2) / 2\sigma^2} \cos(2\pi u / \lambda + \varphi), \quad
        u = x\cos\theta + y\sin\theta,\; v = -x\sin\theta + y\cos\theta,\quad
        \sigma = \frac{\lambda}{\pi}\sqrt{\frac{\ln 2}{2}}\,\frac{2^b + 1}{2^b - 1}

    with y upwards. Positive and negative parts are then scaled to equal weight, so that uniform brightness gives no
    response.

    Source: N. Petkov, "Biologically motivated computationally intensive approaches to image pattern recognition",
    Future Generation Computer Systems 11, 1995; as in G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint
    detection and pattern recognition", PAMI 35, 2013.

    >>> image = torch.ones(1, 1, 32, 32)
    >>> image[..., 15:17] = 0  # a dark upright bar
    >>> bank = GaborBank(wavelengths=(4.0,), orientations=4)
    >>> bank.grid()[bank.describe(image)[0, :, 16, 16].argmax()]  # λ and θ, the direction across it
    tensor([4., 0.], dtype=torch.float64)

    Args:
        wavelengths: λ of the grid.
        orientations: number of θ, evenly spaced over ``span_deg`` from 0.
        span_deg: 180 covers all directions of symmetric kernels (phase 0 or 180), edges need 360; None chooses between
            them.
        phase_deg: φ.
        bandwidth, aspect: see :func:`gabor_kernel`.
        border: how images continue beyond their border.

    Raises:
        ArgumentError: no wavelength, one that pixels cannot resolve (2 or less), no orientation, or a bandwidth or
            aspect that is not positive; or a phase that is not finite.
    """

    @checked
    def __init__(
        self,
        wavelengths: Annotated[tuple[Annotated[float, Gt(2), Le(1000)], ...], MinLen(1)] = (4.0,),
        orientations: Count = 8,
        span_deg: Positive | None = None,
        phase_deg: float = 180.0,
        bandwidth: Positive = 2.0,
        aspect: Positive = 0.5,
        border: Border = "replicate",
    ):
        super().__init__()
        if not fits(float, phase_deg):
            raise ArgumentError(f"phase_deg={phase_deg} must be a finite number", "For example phase_deg=180", of=self)
        self.wavelengths = tuple(float(length) for length in wavelengths)
        self.orientations, self.phase_deg = orientations, phase_deg
        self.symmetric = phase_deg % 180 == 0
        self.span_deg = float(span_deg if span_deg is not None else (180 if self.symmetric else 360))
        self.bandwidth, self.aspect, self.border = bandwidth, aspect, border

    def grid(self) -> Float[Tensor, "k 2"]:
        """Every wavelength in every orientation."""
        turns = [math.radians(self.span_deg * turn / self.orientations) for turn in range(self.orientations)]
        return torch.tensor([[length, theta] for length in self.wavelengths for theta in turns], dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k h w"]:
        """Responses of the grid; see :meth:`Bank.describe`."""
        return self(images, self.grid())  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 2"]) -> Float[Tensor, "b u h w"]:
        """Rectified responses; see :meth:`Bank.forward`."""
        check_grey(images, "GaborBank")
        wavelengths, members = torch.unique(channels[:, 0], return_inverse=True)
        found = images.new_zeros(len(images), len(channels), *images.shape[2:])
        for index, wavelength in enumerate(wavelengths.tolist()):
            rows = (members == index).nonzero()[:, 0]
            kernels = torch.stack([self._kernel(wavelength, float(theta)) for theta in channels[rows, 1]])
            reach = kernels.shape[-1] // 2
            kernels = kernels[:, None].to(images)
            found[:, rows] = F.conv2d(padded(images, reach, self.border), kernels).clamp(min=0)
        return found

    def moved(self, channels: Float[Tensor, "n 2"], move: Move) -> Float[Tensor, "n 2"]:
        """λ grows with the image, θ turns with it; see :meth:`SteerableBank.moved`.

        Raises:
            UserError: the smaller image needs a wavelength that pixels cannot resolve.
        """
        if len(channels) and float(channels[:, 0].min()) * move.scale <= 2:
            raise UserError(
                f"at scale {move.scale:g} Gabor filters have wavelengths down to "
                f"{float(channels[:, 0].min()) * move.scale:g} pixels, and must be above 2",
                "Tolerate fewer small scales, or give the bank longer wavelengths.",
            )
        theta = math.pi - channels[:, 1] if move.mirrored else channels[:, 1]
        whole = math.pi if self.symmetric else 2 * math.pi
        return torch.stack([channels[:, 0] * move.scale, (theta + move.rotation_rad) % whole], 1)

    def options(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        names = ("wavelengths", "orientations", "span_deg", "phase_deg", "bandwidth", "aspect", "border")
        return {name: getattr(self, name) for name in names}

    def _kernel(self, wavelength: float, theta_rad: float) -> Tensor:
        return gabor_kernel(
            wavelength,
            theta_rad,
            phase_rad=math.radians(self.phase_deg),
            bandwidth=self.bandwidth,
            aspect=self.aspect,
        )


class DoGBank(SteerableBank):
    r"""Half-wave rectified differences of Gaussians; a channel is (σ in pixels, polarity).

    .. math:: r_{\pm} = \max(0,\; \pm (g_{\sigma/2} - g_\sigma) * I)

    on a support of ``2 ceil(3 sigma) + 1`` pixels, each Gaussian summing to one on it.

    Source: G. Azzopardi, N. Strisciuglio, M. Vento, N. Petkov, "Trainable COSFIRE filters for vessel delineation with
    application to retinal images", Medical Image Analysis 19, 2015.

    >>> spot = torch.zeros(1, 1, 21, 21)
    >>> spot[..., 9:12, 9:12] = 1
    >>> DoGBank(sigmas=(2.4,), polarities=(1, -1)).describe(spot)[0, :, 10, 10] > 0  # bright, not dark
    tensor([ True, False])

    Args:
        sigmas: σ of the outer Gaussian.
        polarities: 1 for a bright centre, -1 for a dark one.
        ratio: inner σ over outer σ.
        border: how images continue beyond their border.

    Raises:
        ArgumentError: no σ, one that is not positive, or a polarity that is neither 1 nor -1.
    """

    @checked
    def __init__(
        self,
        sigmas: Annotated[tuple[Positive, ...], MinLen(1)] = (2.4,),
        polarities: Annotated[tuple[Literal[-1, 1], ...], MinLen(1)] = (1,),
        ratio: Positive = 0.5,
        border: Border = "replicate",
    ):
        super().__init__()
        self.sigmas, self.polarities, self.ratio = tuple(float(s) for s in sigmas), tuple(polarities), ratio
        self.border = border

    def grid(self) -> Float[Tensor, "k 2"]:
        """Every polarity of every σ."""
        return torch.tensor([[s, sign] for s in self.sigmas for sign in self.polarities], dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k h w"]:
        """Responses of the grid; see :meth:`Bank.describe`."""
        return self(images, self.grid())  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 2"]) -> Float[Tensor, "b u h w"]:
        """Rectified responses; see :meth:`Bank.forward`."""
        check_grey(images, "DoGBank")
        found = images.new_zeros(len(images), len(channels), *images.shape[2:])
        for sigma in torch.unique(channels[:, 0]).tolist():
            reach = math.ceil(3 * sigma)
            image = padded(images, reach, self.border)
            inner, outer = (twice_convolved(image, gaussian_line(s, reach)) for s in (self.ratio * sigma, sigma))
            for row in (channels[:, 0] == sigma).nonzero()[:, 0].tolist():
                found[:, row] = (float(channels[row, 1]) * (inner - outer))[:, 0].clamp(min=0)
        return found

    def moved(self, channels: Float[Tensor, "n 2"], move: Move) -> Float[Tensor, "n 2"]:
        """σ grows with the image; see :meth:`SteerableBank.moved`."""
        return channels * torch.tensor([move.scale, 1.0], dtype=channels.dtype)

    def options(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        return {name: getattr(self, name) for name in ("sigmas", "polarities", "ratio", "border")}


class FeatureBank(Bank):
    """Each channel of a feature map, rectified; named by its number.

    >>> bank = FeatureBank(nn.Conv2d(3, 8, 3, padding=1), size=8)
    >>> maps = bank.describe(torch.rand(2, 3, 16, 16))
    >>> maps.shape, maps.amax((1, 2, 3)).tolist()  # shares of each image's strongest
    (torch.Size([2, 8, 16, 16]), [1.0, 1.0])

    Args:
        features: maps images to ``(b, k, y, x)``, such as ``sextant.models.FeatureMap`` of any layer of any network.
        size: k.
        normalise: divide by the strongest response of the image, so that thresholds and floors are shares of it.
    """

    def __init__(self, features: nn.Module, size: int, *, normalise: bool = True):
        super().__init__()
        self.features, self.size, self.normalise = features, size, normalise

    def grid(self) -> Float[Tensor, "k 1"]:
        """Numbers of the channels."""
        return torch.arange(self.size, dtype=torch.float64)[:, None]

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        maps = _rectified(self.features, images, self.size)
        return _shared_out(maps, maps.amax((1, 2, 3), keepdim=True)) if self.normalise else maps

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """See :meth:`Bank.strongest`."""
        return images.new_ones(len(images)) if self.normalise else super().strongest(images)

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 1"]) -> Float[Tensor, "b u y x"]:
        """Channels of the feature map; see :meth:`Bank.forward`."""
        return self.describe(images)[:, channels[:, 0].long().to(images.device)]


class VectorBank(Bank):
    r"""How well a feature vector points in a direction w: :math:`\max(0, \cos(w, F(y, x)))`.

    >>> bank = VectorBank(nn.Identity(), size=2)  # images are their own features
    >>> image = torch.tensor([3.0, 4.0]).view(1, 2, 1, 1)
    >>> bank(image, torch.tensor([[1.0, 0.0], [0.6, 0.8]])).flatten()
    tensor([0.6000, 1.0000])

    Args:
        features: maps images to ``(b, k, y, x)``.
        size: k.
        least: vectors shorter than this share of the image's longest respond less, so that empty places do not respond.
    """

    learnable = True

    @checked
    def __init__(self, features: nn.Module, size: int, *, least: Annotated[float, Ge(0), Le(1)] = 0.05):
        super().__init__()
        self.features, self.size, self.least = features, size, least

    def grid(self) -> Float[Tensor, "k k"]:
        """The axes."""
        return torch.eye(self.size, dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        return _rectified(self.features, images, self.size)

    def strength(self, maps: Float[Tensor, "b k y x"]) -> Float[Tensor, "b 1 y x"]:
        """Lengths of the vectors: thresholding single components would change their direction."""
        length: Tensor = maps.norm(dim=1, keepdim=True)
        return length

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """1, the cosine of a vector that points exactly in a direction."""
        return images.new_ones(len(images))

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u k"]) -> Float[Tensor, "b u y x"]:
        """Cosines; see :meth:`Bank.forward`."""
        maps = self.describe(images)
        length = maps.norm(dim=1, keepdim=True)
        length = torch.maximum(length, self.least * length.amax((2, 3), keepdim=True))
        directions = F.normalize(channels, dim=1).to(maps)
        return torch.einsum("uk,bkyx->buyx", directions, _shared_out(maps, length)).clamp(min=0)


def _rectified(features: nn.Module, images: Tensor, size: int) -> Tensor:
    """The network's feature map with negative values set to 0.

    Raises:
        UserError: the network cannot take the images, or its features are not floating-point.
        ValueError: its number of channels is not ``size``.
    """
    try:
        maps: Tensor = features(images)
    except torch.cuda.OutOfMemoryError:
        raise
    except RuntimeError as error:
        raise UserError(
            f"the network of the COSFIRE bank cannot take images (b, c, h, w) of {tuple(images.shape)}: "
            f"{str(error).splitlines()[0]}",
            "Give images with its number of channels and of at least its minimum size.",
        ) from error
    if maps.ndim != 4 or maps.shape[1] != size:
        raise ValueError(f"the features are {tuple(maps.shape)}, the bank expects (b, {size}, y, x)")
    return require_floating(maps, "features").clamp(min=0)


def _shared_out(maps: Tensor, whole: Tensor) -> Tensor:
    """Maps as shares of ``whole``; left as they are where ``whole`` is 0."""
    return maps / whole.masked_fill(whole <= 0, 1.0)
