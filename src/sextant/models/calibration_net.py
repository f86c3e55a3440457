"""From an image to the four numbers of a camera, each with its expected error, and to its perspective field."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.geometry.field_fit import BelievedField
from sextant.geometry.perspective_field import PerspectiveField
from sextant.models.canvas import pictures_on_canvas
from sextant.models.efficientnet_lite0 import EfficientNetLite0
from sextant.models.trunk import standardized_before

WIDTH = 128
#: range of the logarithm of an expected error: from 0.4 degrees to more than any error
LOG_ERROR = (-5.0, 1.5)
#: range of the logarithm of the trust in the first estimate, and its initial value
LOG_TRUST, FIRST_LOG_TRUST = (-3.0, 5.0), 2.0
#: distance, in sides of the canvas, by which the centre of a cell may lie outside the picture that it overlaps
OVERLAP = 0.01


class FieldHead(nn.Module):
    """Predicts a latitude and an up direction for each cell of a map, from the cell and the whole picture.

    Args:
        channels: of the map.
        cells: rows and columns of the map.
        features: length of the feature vector of the whole picture.

    Example:
        >>> believed = FieldHead(8, (7, 7), 16)(torch.rand(2, 8, 7, 7), torch.rand(2, 16))
        >>> believed.field.latitude.shape, believed.field.up.shape, believed.log_error.shape, believed.trust.shape
        (torch.Size([2, 49]), torch.Size([2, 49, 2]), torch.Size([2, 2, 49]), torch.Size([2, 4]))
    """

    def __init__(self, channels: int, cells: tuple[int, int], features: int):
        super().__init__()
        self.cells = cells
        self.cell = nn.Conv2d(channels, WIDTH, 1)
        self.context = nn.Linear(features, WIDTH)
        self.place = nn.Parameter(torch.zeros(1, WIDTH, *cells))
        self.mix = nn.Conv2d(WIDTH, WIDTH, 3, padding=1)
        self.out = nn.Conv2d(WIDTH, 5, 1)
        self.trust = nn.Linear(features, 4)
        nn.init.zeros_(self.trust.weight)
        nn.init.constant_(self.trust.bias, FIRST_LOG_TRUST)

    def forward(self, cells: Float[Tensor, "b c h w"], features: Float[Tensor, "b f"]) -> BelievedField:
        """The field of each map's cells, row by row, in single precision."""
        hidden = F.relu(self.cell(cells) + self.context(features)[..., None, None] + self.place)
        hidden = F.relu(hidden + self.mix(hidden))
        said = self.out(hidden).float().flatten(2)
        up = F.normalize(said[:, :2].mT + said.new_tensor([0.0, -1.0]), dim=-1, eps=1e-6)
        trust = torch.exp(self.trust(features).float().clamp(*LOG_TRUST))
        return BelievedField(PerspectiveField(said[:, 2], up), said[:, 3:].clamp(*LOG_ERROR), trust)


def cell_centres(
    cells: tuple[int, int], aspect: Float[Tensor, "b"]
) -> tuple[Float[Tensor, "b n 2"], Bool[Tensor, "b n"]]:
    """Centres of the cells of a square canvas, in its sides from the middle, and which lie in pictures of an aspect.

    >>> points, seen = cell_centres((2, 3), torch.tensor([0.5]))
    >>> points[0, :3, 0], seen[0]
    (tensor([-0.3333,  0.0000,  0.3333]), tensor([False,  True, False, False,  True, False]))
    """
    down, across = ((torch.arange(n, dtype=aspect.dtype, device=aspect.device) + 0.5) / n - 0.5 for n in cells)
    rows, columns = torch.meshgrid(down, across, indexing="ij")
    points = torch.stack([columns, rows], -1).reshape(1, -1, 2).expand(len(aspect), -1, -1)
    half = torch.stack([aspect.clamp(max=1), 1 / aspect.clamp(min=1)], -1)[:, None] / 2
    return points, (points.abs() <= half + OVERLAP).all(-1)


HIDDEN = 64
#: range of the log of a predicted scale: e^-7 rad is 0.05 degrees, e^2 is beyond any range
LOG_SCALE = (-7.0, 2.0)


class CalibrationOutput(NamedTuple):
    """The network's prediction.

    Attributes:
        unit: the four numbers as positions within their ranges, each in (0, 1).
        log_scale: log of the expected absolute error of tilt, roll, vfov (radians) and apparent distortion.
        believed: the perspective field of the cells of the image; None for a network without it.
    """

    unit: Float[Tensor, "b 4"]
    log_scale: Float[Tensor, "b 4"]
    believed: BelievedField | None = None


def coordinate_channels(height: int, width: int, aspect: Float[Tensor, "b"]) -> Float[Tensor, "b 3 height width"]:
    """Coordinates of each pixel: u, v in image heights from the centre, and u² + v²; ``aspect`` is width over height.

    Source: R. Liu et al., "An intriguing failing of convolutional neural networks and the CoordConv solution", 2018.

    >>> u, v, square = coordinate_channels(2, 4, torch.tensor([2.0]))[0]  # an image twice as wide as high
    >>> u[0], v[:, 0]
    (tensor([-0.7500, -0.2500,  0.2500,  0.7500]), tensor([-0.2500,  0.2500]))
    """
    v = (torch.arange(height, dtype=aspect.dtype, device=aspect.device) + 0.5) / height - 0.5
    u = ((torch.arange(width, dtype=aspect.dtype, device=aspect.device) + 0.5) / width - 0.5) * aspect[:, None]
    v, u = v[None, :, None].expand(aspect.shape[0], height, width), u[:, None, :].expand(-1, height, width)
    return torch.stack([u, v, u * u + v * v], 1)


class CalibrationNet(nn.Module):
    """A backbone with a head for each of the four numbers, and one for each expected error.

    The gradients of the expected errors' heads do not reach the features: the predicted camera is the same with and
    without these heads.

    Args:
        backbone: maps ``(b, c, h, w)`` to ``features`` numbers; c is 6 with ``coordinates``, else 3.
        features: number of features.
        coordinates: append the channels of :func:`coordinate_channels`.
        lines: the images are squares with pictures in their middles, low-passed to this many lines per side
            (:mod:`sextant.models.canvas`); None for pictures squashed to the input.
        field: also predict the perspective field of the cells of the backbone's map.

    Raises:
        ArgumentError: ``field`` is true and the backbone does not return its map.

    Example:
        >>> from sextant.models import StridedCNN
        >>> network = CalibrationNet(StridedCNN(6, (96, 128), num_classes=32), features=32)
        >>> says = network(torch.rand(2, 3, 96, 128), torch.full((2,), 4 / 3))
        >>> says.unit.shape, says.log_scale.shape
        (torch.Size([2, 4]), torch.Size([2, 4]))
    """

    def __init__(
        self,
        backbone: nn.Module,
        features: int,
        *,
        coordinates: bool = True,
        lines: float | None = None,
        field: bool = False,
    ):
        super().__init__()
        self.lines = lines
        self.backbone, self.coordinates = backbone.to(memory_format=torch.channels_last), coordinates  # faster on CPUs
        standardized_before(self.backbone, (0.5,) * 3, (0.5,) * 3)
        self.values = nn.ModuleList(_head(features) for _ in range(4))
        self.scales = nn.ModuleList(_head(features) for _ in range(4))
        self.field: FieldHead | None = None
        if field:
            if not isinstance(backbone, EfficientNetLite0):
                raise ArgumentError(f"field: {type(backbone).__name__} does not return its map of cells")
            self.field = FieldHead(backbone.channels, backbone.grid, features)

    def forward(self, images: Float[Tensor, "b 3 h w"], aspect: Float[Tensor, "b"]) -> CalibrationOutput:
        """Outputs for images in [0, 1] of pictures whose width is ``aspect`` times their height."""
        x = 2 * images - 1
        if self.lines is not None:
            x = pictures_on_canvas(x, aspect, self.lines)
            aspect = torch.ones_like(aspect)
        if self.coordinates:
            x = torch.cat([x, coordinate_channels(images.shape[-2], images.shape[-1], aspect.to(x))], 1)
        x, believed = x.contiguous(memory_format=torch.channels_last), None
        if self.field is None:
            features = F.relu(self.backbone(x))
        else:
            outputs, cells = self.backbone(x, with_cells=True)
            features = F.relu(outputs)
            believed = self.field(cells, features)
        # cameras are computed in single precision: with the three digits of half precision tilt would lose degrees
        unit = torch.sigmoid(torch.cat([head(features) for head in self.values], 1).float())
        log_scale = torch.cat([head(features.detach()) for head in self.scales], 1).float()
        return CalibrationOutput(unit, log_scale.clamp(*LOG_SCALE), believed)


def _head(features: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(features, HIDDEN), nn.ReLU(inplace=True), nn.Linear(HIDDEN, 1))
