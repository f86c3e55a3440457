r"""The camera that best fits a perspective field, whose points are weighted by their expected errors.

From a first estimate :math:`x_0` of tilt, roll, log focal length and k1, a few damped Gauss-Newton steps minimise

.. math:: \tfrac12 |T (x - x_0)|^2 + \tfrac12 \sum_i \left[
          \rho\!\left(\frac{\sqrt{w}\, \Delta\varphi_i}{\sigma_{\varphi,i}}\right)
        + \rho\!\left(\frac{\sqrt{w}\, \Delta\upsilon_i}{\sigma_{\upsilon,i}}\right) \right] ,
          \qquad \rho(e) = 2 (\sqrt{1 + e^2} - 1) ,

with the errors of latitude and up direction in units of those expected, and the trust T in the first estimate. Errors
of neighbouring points are correlated, so a point has less weight than an independent one (:math:`w`). All steps are
differentiable, so that the expected errors are learnt from the loss of the fitted camera.

Source: A. Veicht et al., "GeoCalib: learning single-image calibration with geometric optimization", ECCV 2024.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.geometry.distortion import K2Family, k2_of_k1, max_distorted_radius
from sextant.geometry.parameterization import CameraParameters
from sextant.geometry.perspective_field import PerspectiveField, field_errors, perspective_field

#: weight of a point, w
EVIDENCE = 0.15
STEPS, LONGEST_STEP, DAMPING, DIFFERENCE = 5, 0.3, 1e-3, 1e-4
#: bounds of tilt, roll, log focal length and k1, wider than those of any camera
LOWEST, HIGHEST = (-1.55, -3.2, -3.0, -2.0), (1.55, 3.2, 4.0, 2.0)


class BelievedField(NamedTuple):
    """A predicted perspective field with its expected errors.

    Attributes:
        field: latitudes and up directions of n points.
        log_error: logarithms of the expected errors of each, radians.
        trust: T, roots of the weights of the first estimate's tilt, roll, log focal length and k1.
    """

    field: PerspectiveField
    log_error: Float[Tensor, "b 2 n"]
    trust: Float[Tensor, "b 4"]


def fit_field(
    start: CameraParameters,
    believed: BelievedField,
    points: Float[Tensor, "b n 2"],
    seen: Bool[Tensor, "b n"],
    family: K2Family = "lopez",
) -> CameraParameters:
    """Cameras fitted to fields, in double precision.

    Args:
        start: first estimates.
        believed: the fields.
        points: positions of their points, in image heights from the centre.
        seen: points that count; those beyond the fold of a lens never do.
        family: family of the lenses.

    >>> true, near = (CameraParameters(*torch.tensor(x).T) for x in ([[0.2, 0.1, 0.9, -0.1]], [[0.1, 0.0, 1.2, 0.0]]))
    >>> points = torch.rand(1, 40, 2, generator=torch.Generator().manual_seed(0)) - 0.5
    >>> sure = BelievedField(perspective_field(true, points), torch.full((1, 2, 40), -5.0), torch.full((1, 4), 0.1))
    >>> [round(float(x), 2) for x in fit_field(near, sure, points, torch.ones(1, 40, dtype=torch.bool))]
    [0.2, 0.1, 0.9, -0.1]
    """
    field = PerspectiveField(believed.field.latitude.double(), believed.field.up.double())
    weight = torch.exp(-believed.log_error.double()) * EVIDENCE**0.5
    first = torch.stack([start.tilt, start.roll, start.focal.log(), start.k1], -1).double()
    trust, points = believed.trust.double().square(), points.double()
    radius = torch.linalg.vector_norm(points, dim=-1)
    apart = torch.cat([first.new_zeros(1, 4), DIFFERENCE * torch.eye(4).to(first)])
    lowest, highest = first.new_tensor(LOWEST), first.new_tensor(HIGHEST)
    found = first
    for _ in range(STEPS):
        errors = field_errors(perspective_field(_camera(found + apart[:, None]), points, family), field)
        counted = seen & _before_the_fold(_camera(found.detach()), radius, family)
        residuals = (_robust(errors * weight) * counted[:, None]).flatten(-2)
        slope = ((residuals[1:] - residuals[0]) / DIFFERENCE).permute(1, 2, 0)
        curvature = slope.mT @ slope + torch.diag_embed(trust + DAMPING)
        gradient = (slope.mT @ residuals[0][..., None])[..., 0] + trust * (found - first)
        step = torch.linalg.solve(curvature, gradient).clamp(-LONGEST_STEP, LONGEST_STEP)
        found = torch.minimum(torch.maximum(found - step, lowest), highest)
    return _camera(found)


def _camera(found: Float[Tensor, "*b 4"]) -> CameraParameters:
    tilt, roll, log_focal, k1 = found.unbind(-1)
    return CameraParameters(tilt, roll, log_focal.exp(), k1)


def _before_the_fold(camera: CameraParameters, radius: Float[Tensor, "b n"], family: K2Family) -> Bool[Tensor, "b n"]:
    k2 = k2_of_k1(camera.k1, family)
    return radius < (camera.focal * max_distorted_radius(camera.k1, k2))[:, None]


def _robust(errors: Tensor) -> Tensor:
    """Roots of the loss, with the sign of the errors."""
    return errors * torch.rsqrt(0.5 * ((1 + errors.square()).sqrt() + 1))
