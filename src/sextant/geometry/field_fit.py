r"""The camera that fits a perspective field best, point by point as far as each is trusted.

From a first answer x of tilt, roll, log focal length and k1, a few damped steps of Gauss and Newton minimise

.. math:: \tfrac12 |W (x - x_0)|^2 + \tfrac12\, w \sum_i
          \rho\!\left(\frac{\Delta\varphi_i}{\sigma_{\varphi,i}}\right)
        + \rho\!\left(\frac{\Delta\upsilon_i}{\sigma_{\upsilon,i}}\right) ,
          \qquad \rho(e) = 2 (\sqrt{1 + e^2} - 1) ,

with the errors of latitude and up direction in units of those that are expected. Points err alike, and so count less
than as many independent ones (:math:`w`). All steps are differentiable, so that what is believed of each point can be
learnt from the camera that follows from all of them.

Source: A. Veicht et al., "GeoCalib: learning single-image calibration with geometric optimization", ECCV 2024.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.geometry.distortion import K2Family
from sextant.geometry.parameterization import CameraParameters
from sextant.geometry.perspective_field import PerspectiveField, field_errors, perspective_field

#: weight of a point, as neighbours err alike
EVIDENCE = 0.15
STEPS, LONGEST_STEP, DAMPING, DIFFERENCE = 5, 0.3, 1e-3, 1e-4
#: ends of tilt, roll, log focal length and k1
LOWEST, HIGHEST = (-1.55, -3.2, -1.3, -0.6), (1.55, 3.2, 2.3, 0.6)


class BelievedField(NamedTuple):
    """A perspective field as it is believed.

    Attributes:
        field: latitudes and up directions of n points.
        log_error: logarithms of the errors expected of each, radians.
        held: root of the weight that the first answer has beside the field, for tilt, roll, log focal length and k1.
    """

    field: PerspectiveField
    log_error: Float[Tensor, "b 2 n"]
    held: Float[Tensor, "b 4"]


def fit_field(
    start: CameraParameters,
    believed: BelievedField,
    points: Float[Tensor, "b n 2"],
    seen: Bool[Tensor, "b n"],
    family: K2Family = "lopez",
) -> CameraParameters:
    """Cameras fitted to fields, in double precision.

    Args:
        start: first answers, which the fits are held to.
        believed: the fields.
        points: where these are, in image heights from the centre.
        seen: points that count.
        family: of the lenses.

    >>> true, near = (CameraParameters(*torch.tensor(x).T) for x in ([[0.2, 0.1, 0.9, 0.0]], [[0.1, 0.0, 1.2, 0.0]]))
    >>> points = torch.rand(1, 40, 2, generator=torch.Generator().manual_seed(0)) - 0.5
    >>> sure = BelievedField(perspective_field(true, points), torch.full((1, 2, 40), -5.0), torch.full((1, 4), 0.1))
    >>> [round(float(x), 3) for x in fit_field(near, sure, points, torch.ones(1, 40, dtype=torch.bool))]
    [0.2, 0.1, 0.9, 0.0]
    """
    field = PerspectiveField(believed.field.latitude.double(), believed.field.up.double())
    weight = torch.exp(-believed.log_error.double()) * seen[:, None] * EVIDENCE**0.5
    first = torch.stack([start.tilt, start.roll, start.focal.log(), start.k1], -1).double()
    held, points = believed.held.double().square(), points.double()
    apart = torch.cat([first.new_zeros(1, 4), DIFFERENCE * torch.eye(4).to(first)])
    lowest, highest = first.new_tensor(LOWEST), first.new_tensor(HIGHEST)
    found = first
    for _ in range(STEPS):
        errors = field_errors(perspective_field(_camera(found + apart[:, None]), points, family), field)
        residuals = _robust(errors * weight).flatten(-2)
        slope = ((residuals[1:] - residuals[0]) / DIFFERENCE).permute(1, 2, 0)
        curvature = slope.mT @ slope + torch.diag_embed(held + DAMPING)
        gradient = (slope.mT @ residuals[0][..., None])[..., 0] + held * (found - first)
        step = torch.linalg.solve(curvature, gradient).clamp(-LONGEST_STEP, LONGEST_STEP)
        found = torch.minimum(torch.maximum(found - step, lowest), highest)
    return _camera(found)


def _camera(found: Float[Tensor, "*b 4"]) -> CameraParameters:
    tilt, roll, log_focal, k1 = found.unbind(-1)
    return CameraParameters(tilt, roll, log_focal.exp(), k1)


def _robust(errors: Tensor) -> Tensor:
    """Roots of the loss, with the sign of the errors."""
    return errors * torch.rsqrt(0.5 * ((1 + errors.square()).sqrt() + 1))
