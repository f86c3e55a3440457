r"""The perspective camera with radial distortion: square pixels, principal point at the image centre.

With lengths in image heights, a direction ``(X, Y, Z)`` is seen at :math:`(u, v) = f d\,(X/Z, Y/Z)`,
:math:`d = 1 + k_1 r^2 + k_2 r^4`, :math:`r^2 = (X^2 + Y^2)/Z^2`; see :mod:`sextant.geometry.distortion`.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sextant.errors import UserError
from sextant.geometry.camera import Camera, check_image_size, floating, heights_from_pixels, pixels_from_heights
from sextant.geometry.distortion import (
    K2Family,
    distortion_factor,
    k2_of_k1,
    max_distorted_radius,
    max_radius,
    undistort_radius,
)
from sextant.shapes import check_shape


def perspective_bearings(
    points: Float[Tensor, "*#n 2"], focal: Float[Tensor, "*#n"], k1: Float[Tensor, "*#n"], k2: Float[Tensor, "*#n"]
) -> Float[Tensor, "*#n 3"]:
    r"""Unit directions of the rays through image points in image heights from the centre.

    :math:`c = (u/(f d), v/(f d), 1)` normalised, with d at the undistorted radius. The parameters broadcast against
    the points without their last dimension. Nothing is checked, so that it serves a network in training; differentiable
    in everything, the centre included. Points beyond the fold keep the d of the fold.

    >>> focal, k1, k2 = torch.tensor(1.0), torch.tensor(0.0), torch.tensor(0.0)
    >>> perspective_bearings(torch.tensor([[0.0, 0.0], [1.0, 0.0]]), focal, k1, k2)
    tensor([[0.0000, 0.0000, 1.0000],
            [0.7071, 0.0000, 0.7071]])
    """
    normalised = points / focal[..., None]
    square = normalised.square().sum(dim=-1)
    centre = square == 0  # the root has no derivative there, but its square, which is all that is used, has
    radius = undistort_radius(torch.where(centre, 0, torch.where(centre, 1, square).sqrt()), k1, k2)
    rays = normalised / distortion_factor(radius * radius, k1, k2)[..., None]
    rays = torch.cat([rays, torch.ones_like(rays[..., :1])], dim=-1)
    length: Tensor = torch.linalg.vector_norm(rays, dim=-1, keepdim=True)
    return rays / length


def perspective_project(
    directions: Float[Tensor, "*#n 3"], focal: Float[Tensor, "*#n"], k1: Float[Tensor, "*#n"], k2: Float[Tensor, "*#n"]
) -> tuple[Float[Tensor, "*#n 2"], Bool[Tensor, "*#n"]]:
    """Image points, in image heights from the centre, at which directions are seen; the inverse of the bearings.

    The second result is false behind the camera (``Z <= 0``, to rounding) and beyond the fold radius; the point means
    nothing there, but it is finite and so are its gradients.

    >>> focal, k1, k2 = torch.tensor(1.0), torch.tensor(-0.2), torch.tensor(0.0)
    >>> perspective_project(torch.tensor([[1.0, 0.0, 2.0], [0.0, 0.0, -1.0]]), focal, k1, k2)
    (tensor([[0.4750, 0.0000],
            [0.0000, 0.0000]]), tensor([ True, False]))
    """
    directions = floating(directions)
    across = directions[..., :2].detach().abs().amax(dim=-1)
    in_front = directions[..., 2] > torch.finfo(directions.dtype).eps * across
    depth = torch.where(in_front, directions[..., 2], 1)
    ideal = directions[..., :2] / depth[..., None]
    square = ideal.square().sum(dim=-1)
    visible = in_front & (square <= max_radius(k1, k2).square())
    factor = distortion_factor(torch.where(visible, square, 0), k1, k2)
    return ideal * (focal * factor)[..., None], visible


@dataclass(frozen=True, eq=False)
class PerspectiveCamera(Camera):
    """A perspective camera with radial distortion, or a batch of them with images of one size.

    >>> camera = PerspectiveCamera.from_focal(1.2, 640, 480, k1=-0.2)
    >>> camera.bearings(torch.tensor([320.0, 240.0]))
    tensor([0., 0., 1.])
    >>> pixels, visible = camera.project(torch.tensor([0.1, 0.0, 1.0]))
    >>> pixels
    tensor([377.4850, 240.0000])

    Args:
        focal: focal length in image heights, above 0.
        k1: first coefficient of the distortion; negative is barrel distortion.
        k2: second coefficient; see :func:`~sextant.geometry.k2_of_k1`.
        width: image width in pixels.
        height: image height in pixels.

    Raises:
        UserError: a value is not finite or out of its range, or the corners of the image lie beyond the fold of the
            polynomial, where no ray is.
    """

    focal: Float[Tensor, "*#batch"]
    k1: Float[Tensor, "*#batch"]
    k2: Float[Tensor, "*#batch"]
    width: int
    height: int

    def __post_init__(self) -> None:
        check_image_size(self.width, self.height)
        _check("focal", self.focal, self.focal > 0, "is a positive number of image heights", "focal=0.8")
        _check("k1", self.k1, self.k1.isfinite(), "is finite", "k1=-0.2")
        _check("k2", self.k2, self.k2.isfinite(), "is finite", "k2=0.0")
        self._check_corner()

    def _check_corner(self) -> None:
        corner = math.hypot(self.width / self.height, 1) / 2 / self.focal.detach()
        reach = max_distorted_radius(self.k1.detach(), self.k2.detach())
        corner, reach, k1, k2, focal = torch.broadcast_tensors(corner, reach, self.k1, self.k2, self.focal)
        if (corner > reach).any():
            worst = (corner / reach).argmax()
            f, a, b, limit = (values.flatten()[worst].item() for values in (focal, k1, k2, corner / reach * focal))
            raise UserError(
                f"with focal={f:.4g}, k1={a:.4g}, k2={b:.4g} the corners of a {self.width}x{self.height} image lie "
                "beyond the radius at which the distortion folds the image over",
                f"Use focal >= {math.ceil(limit * 1e4) / 1e4:g} (image heights), a k1 nearer to 0, or k2_of_k1=lopez.",
            )

    @classmethod
    def from_focal(
        cls,
        focal: float | Float[Tensor, "*#batch"],
        width: int,
        height: int,
        *,
        k1: float | Float[Tensor, "*#batch"] = 0.0,
        k2: float | Float[Tensor, "*#batch"] | None = None,
        family: K2Family | None = None,
    ) -> "PerspectiveCamera":
        """A camera of ``focal`` image heights.

        ``k2`` is that of the lens family (``lopez`` unless given), or free if it is given. Numbers take the type and
        device of the first tensor among ``focal``, ``k1`` and ``k2``, or torch's default.
        """
        given = (value for value in (focal, k1, k2) if isinstance(value, Tensor))
        like = floating(next(given, torch.empty(())))
        focal, k1 = (torch.as_tensor(value, dtype=like.dtype, device=like.device) for value in (focal, k1))
        k2 = None if k2 is None else torch.as_tensor(k2, dtype=like.dtype, device=like.device)
        family = family or ("lopez" if k2 is None else "free")
        return cls(focal, k1, k2_of_k1(k1, family, k2), width, height)

    @classmethod
    def from_focal_pixels(
        cls,
        focal_px: float | Float[Tensor, "*#batch"],
        width: int,
        height: int,
        *,
        k1: float | Float[Tensor, "*#batch"] = 0.0,
        k2: float | Float[Tensor, "*#batch"] | None = None,
        family: K2Family | None = None,
    ) -> "PerspectiveCamera":
        """A camera of focal length ``focal_px`` pixels; the rest as in :meth:`from_focal`."""
        check_image_size(width, height)
        return cls.from_focal(focal_px / height, width, height, k1=k1, k2=k2, family=family)

    @classmethod
    def from_vfov(
        cls,
        vfov: float | Float[Tensor, "*#batch"],
        width: int,
        height: int,
        *,
        k1: float | Float[Tensor, "*#batch"] = 0.0,
        k2: float | Float[Tensor, "*#batch"] | None = None,
        family: K2Family | None = None,
    ) -> "PerspectiveCamera":
        """A camera of nominal vertical field of view ``vfov``, radians in (0, π); the rest as in :meth:`from_focal`.

        ``f = 1 / (2 tan(vfov / 2))``. Distortion makes the true field of view another one: :attr:`true_vfov`.

        Raises:
            UserError: ``vfov`` is out of its range, or as for the class.
        """
        angle = torch.as_tensor(vfov)
        _check("vfov", angle, (angle > 0) & (angle < math.pi), "lies between 0 and pi radians", "vfov=1.05 (60 deg)")
        half_height = torch.tan(vfov / 2) if isinstance(vfov, Tensor) else math.tan(vfov / 2)
        return cls.from_focal(0.5 / half_height, width, height, k1=k1, k2=k2, family=family)

    @property
    def vfov(self) -> Float[Tensor, "*#batch"]:
        """Nominal vertical field of view ``2 atan(1 / (2 f))``, radians: that of the lens without its distortion."""
        return 2 * torch.atan(0.5 / self.focal)

    @property
    def true_vfov(self) -> Float[Tensor, "*batch"]:
        """Angle between the rays through the middles of the top and bottom edges, radians: ``2 atan(r(1 / (2 f)))``."""
        return 2 * torch.atan(undistort_radius(0.5 / self.focal, self.k1, self.k2))

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch of cameras; empty for one camera."""
        return torch.Size(torch.broadcast_shapes(self.focal.shape, self.k1.shape, self.k2.shape))

    @property
    def dtype(self) -> torch.dtype:
        """Type of the focal length."""
        return self.focal.dtype

    @property
    def device(self) -> torch.device:
        """Device of the focal length."""
        return self.focal.device

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> "PerspectiveCamera":
        """The same camera on another device or of another type."""
        focal, k1, k2 = (value.to(device=device, dtype=dtype) for value in (self.focal, self.k1, self.k2))
        return PerspectiveCamera(focal, k1, k2, self.width, self.height)

    def bearings(self, points: Float[Tensor, "*n 2"]) -> Float[Tensor, "*m 3"]:
        """Unit directions, in the camera frame, of the rays through ``points`` (pixels); see `perspective_bearings`."""
        check_shape("points", points, ..., 2)
        heights = heights_from_pixels(points, self.width, self.height)
        return perspective_bearings(heights, *self._parameters_for(points))

    def project(self, directions: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*m 2"], Bool[Tensor, "*m"]]:
        """Pixels at which ``directions`` are seen, and whether they are; see `perspective_project`."""
        check_shape("directions", directions, ..., 3)
        heights, visible = perspective_project(directions, *self._parameters_for(directions))
        return pixels_from_heights(heights, self.width, self.height), visible

    def _parameters_for(self, points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Focal length and coefficients with the batch's dimensions first, then one of size 1 for every other."""
        batch = self.batch_shape
        others = points.ndim - 1 - len(batch)
        if others < 0:
            raise ValueError(
                f"a batch of {tuple(batch)} cameras needs points {(*batch, '*n')}, got {tuple(points.shape)}"
            )
        shape = (*batch, *[1] * others)
        focal, k1, k2 = (value.expand(batch).reshape(shape) for value in (self.focal, self.k1, self.k2))
        return focal, k1, k2


def _check(name: str, values: Tensor, right: Tensor, legal: str, example: str) -> None:
    wrong = ~(right & values.isfinite())
    if wrong.any():
        raise UserError(
            f"{name} {legal}, got {name}={values[wrong].flatten()[0].item():.4g}", f"For example {example}."
        )
