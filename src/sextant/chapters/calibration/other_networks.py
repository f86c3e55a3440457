"""Networks of others as evidence: anything that predicts a camera, a perspective field or rays, with spreads."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, get_args, runtime_checkable

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.atomic_files import file_sha256
from sextant.baselines.calibration import CameraBelief, Observed, ObservedField, ObservedRays
from sextant.errors import ArgumentError, UserError
from sextant.models.field_net import MULTIPLE, FieldNet
from sextant.models.published_camera_file import TITLES, USAGE, Kind, read_published_camera_net
from sextant.models.ray_net import RayNet
from sextant.ranges import Positive, checked

#: shorter side of GeoCalib's images, and the residual at which its authors' cost turns linear, which is taken as the
#: spread of a point of confidence 1
SHORTER, SPREAD = 320, 0.01
#: least confidence of a point, with a spread of ten radians: it does not count
FAINTEST = 1e-6
#: pixels of AnyCalib's images, and the ends of their height over width
PIXELS, SHAPES = 102_400, (0.5, 2.0)
#: word in the names of the authors' files of weights that were trained on pictures without distortion
STRAIGHT = "pinhole"
#: rows and columns of the points of a field that are used
ROWS, COLUMNS = 24, 32


@runtime_checkable
class PhotoNetwork(Protocol):
    """A network that :class:`~sextant.applications.PhotoCalibrator` takes beside, or instead of, its own.

    Example:
        >>> class Level:
        ...     def predict(self, image):
        ...         return CameraBelief(tilt=0.0, roll=0.0, focal=1.0, k1_hat=0.0, sigma=(0.1, 0.05, 0.2, 0.1))
        >>> isinstance(Level(), PhotoNetwork)
        True
    """

    def predict(self, image: UInt8[ndarray, "h w 3"]) -> CameraBelief | Observed:
        """What the network says of a photo, lengths in heights of the photo.

        Args:
            image: the upright photo, RGB bytes, as large as it was given.

        Returns:
            A :class:`~sextant.baselines.calibration.CameraBelief`, whose standard errors are infinite where a number is
            not known; or an :class:`~sextant.baselines.calibration.ObservedField` or
            :class:`~sextant.baselines.calibration.ObservedRays`, to which a camera is fitted.
        """


@checked
@dataclass(frozen=True, eq=False)
class OtherNetwork:
    """A network of others with the scale of its spreads.

    Attributes:
        source: the network.
        scale: factors on the standard errors of tilt, roll, vfov and k1_hat.

    Raises:
        ArgumentError: ``source`` has no method ``predict``, or the factors are not four positive numbers.
    """

    source: PhotoNetwork
    scale: tuple[Positive, Positive, Positive, Positive] = (1.0, 1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not isinstance(self.source, PhotoNetwork) or isinstance(self.source, type):
            raise ArgumentError(
                f"network={self.source!r} has no method predict",
                "Give a trained CameraNetwork, or an object whose predict(image) returns a CameraBelief, an "
                "ObservedField or ObservedRays.",
            )

    def believed(self, image: UInt8[ndarray, "h w 3"], name: str) -> CameraBelief:
        """The camera that it believes in, with scaled standard errors.

        Raises:
            UserError: it returns something else.
            ArithmeticError: no camera fits what it says.
        """
        said: Any = self.source.predict(image)
        found = said.belief() if isinstance(said, Observed) else said
        if not isinstance(found, CameraBelief) or found.zoom != 1:
            raise UserError(
                f"{name}: network.predict returned {type(said).__name__}, not a CameraBelief in heights of the photo, "
                "an ObservedField or ObservedRays",
                "See sextant.chapters.calibration.other_networks.PhotoNetwork.",
            )
        tilt, roll, vfov, k1_hat = (float(a * b) for a, b in zip(found.sigma, self.scale, strict=True))
        return replace(found, sigma=(tilt, roll, vfov, k1_hat))


class FieldSource:
    """GeoCalib's network: photos to fields; a point's spread is ``0.01 / sqrt(confidence)``.

    Args:
        network: the network.
        card: what is known about it.
        distortion: whether it was trained on pictures with distortion, so that it can tell it.
    """

    def __init__(self, network: FieldNet, card: dict[str, Any] | None = None, *, distortion: bool = True):
        self.network, self.card, self.distortion = network.eval(), card or {}, distortion

    @torch.no_grad()
    def predict(self, image: UInt8[ndarray, "h w 3"]) -> ObservedField:
        """The field of the largest centred part whose sides are multiples of 32 once the shorter one is 320."""
        rows, columns = image.shape[:2]
        scale = SHORTER / min(rows, columns)
        size = (max(int(rows * scale), SHORTER), max(int(columns * scale), SHORTER))
        resized = F.interpolate(_in_unit(image), size, mode="bilinear", antialias=True)
        (top, height), (left, width) = (_middle(side, side // MULTIPLE * MULTIPLE) for side in size)
        field = self.network(resized[..., top : top + height, left : left + width])
        y, x = _picked(height, ROWS), _picked(width, COLUMNS)

        def at(values: Tensor) -> Float64[ndarray, "n"]:
            return values[..., y[:, None], x].double().flatten(-2).numpy()

        points = _points(y + top + 0.5, x + left + 0.5, size, columns / rows)
        latitude_sigma, up_sigma = (
            SPREAD / np.sqrt(np.maximum(at(each)[0], FAINTEST))
            for each in (field.latitude_confidence, field.up_confidence)
        )
        latitude, up = at(field.latitude)[0], at(field.up)[0].T
        return ObservedField(points, latitude, up, latitude_sigma, up_sigma, self.distortion)


class RaySource:
    """AnyCalib's network: photos to rays. It gives neither gravity nor spreads; these are measured by the fit.

    Args:
        network: the network.
        card: what is known about it.
        distortion: whether it was trained on pictures with distortion, so that it can tell it.
    """

    def __init__(self, network: RayNet, card: dict[str, Any] | None = None, *, distortion: bool = True):
        self.network, self.card, self.distortion = network.eval(), card or {}, distortion

    @torch.no_grad()
    def predict(self, image: UInt8[ndarray, "h w 3"]) -> ObservedRays:
        """The rays of the largest centred part of a shape that it knows, at about 100,000 pixels."""
        rows, columns = image.shape[:2]
        shape = min(max(rows / columns, SHAPES[0]), SHAPES[1])
        patch, across = self.network.patch, (PIXELS / shape) ** 0.5
        height, width = (max(round(side / patch), 1) * patch for side in (across * shape, across))
        part = (min(rows, round(columns * height / width)), min(columns, round(rows * width / height)))
        (top, _), (left, _) = _middle(rows, part[0]), _middle(columns, part[1])
        cut = _in_unit(image)[..., top : top + part[0], left : left + part[1]]
        resized = F.interpolate(cut, (height, width), mode="bicubic", antialias=True).clamp(0, 1)
        y, x = _picked(height, ROWS), _picked(width, COLUMNS)
        rays = self.network(resized)[0][:, y[:, None], x].double().flatten(1).numpy().T
        down, right = (y + 0.5) * part[0] / height + top, (x + 0.5) * part[1] / width + left
        return ObservedRays(_points(down, right, (rows, columns), columns / rows), rays, None, self.distortion)


def open_network(reference: str) -> FieldSource | RaySource:
    """The network that ``geocalib:<file>`` or ``anycalib:<file>`` names.

    >>> open_network("geocalib:geocalib-pinhole.tar").card["kind"]  # doctest: +SKIP
    'GeoCalib'

    Raises:
        UserError: there is no such kind or file, or the file does not fit (nothing in it is executed).
    """
    kind, _, file = reference.partition(":")
    if kind not in get_args(Kind) or not file:
        raise UserError(f"network={reference} must be geocalib:<file> or anycalib:<file>", USAGE)
    path = Path(file).expanduser()
    found = read_published_camera_net(kind, path)  # type: ignore[arg-type]  # one of them
    card = {
        "kind": TITLES[found.kind],
        "numbers": sum(each.numel() for each in found.network.parameters()),
        "file": path.name,
        "sha256": file_sha256(path),
        "unused": list(found.unused),
        "distortion": STRAIGHT not in path.name,
    }
    if isinstance(found.network, FieldNet):
        images = f"photos with a shorter side of {SHORTER} pixels, blue first, in [0, 255]"
        return FieldSource(found.network, card | {"images": images}, distortion=STRAIGHT not in path.name)
    images = f"photos of {PIXELS:,} pixels with ImageNet's mean and deviation"
    return RaySource(found.network, card | {"images": images}, distortion=STRAIGHT not in path.name)


def card_text(card: dict[str, Any]) -> str:
    """What is known about a network of others, in one line."""
    lens = "" if card["distortion"] else f", trained without distortion by its name ({STRAIGHT})"
    unused = card["unused"]
    left = f"; {len(unused):,} of its arrays are not used: {', '.join(unused[:3])}" if unused else ""
    return (
        f"{card['kind']}, {card['numbers'] / 1e6:.1f} million weights{lens}, {card['images']}; {card['file']}, SHA-256 "
        f"{card['sha256']}{left}; not supplied by Sextant"
    )


def _in_unit(image: UInt8[ndarray, "h w 3"]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))[None]).float() / 255


def _middle(side: int, kept: int) -> tuple[int, int]:
    """Start and length of the middle of a side."""
    return (side - kept) // 2, kept


def _picked(side: int, count: int) -> ndarray:
    """Pixels in the middles of ``count`` equal parts of a side, or all of them."""
    count = min(count, side)
    return ((np.arange(count) + 0.5) * side / count).astype(int)


def _points(down: ndarray, right: ndarray, size: tuple[int, int], aspect: float) -> Float64[ndarray, "n 2"]:
    """Pixels of a photo resized to ``size`` as points in its heights from the centre."""
    grid = np.meshgrid((right / size[1] - 0.5) * aspect, down / size[0] - 0.5)
    return np.column_stack([each.ravel() for each in grid])
