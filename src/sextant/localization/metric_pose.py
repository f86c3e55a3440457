r"""Metric poses as evidence: the pose that correspondences give an image, in the plane, and how it errs.

A pose of six dimensions with covariance loses height, tilt and roll: of its normal density only the marginal of x, y
and the heading is kept. With the located pose y, its covariance :math:`\Sigma`, and the volume V of the map's poses,

.. math:: l(y \mid x) = \log\!\Big[(1 - w)\, t_\nu\big(y;\, x,\, s^2 \Sigma\big) V + w\Big]

is its log-likelihood relative to a pose that tells nothing: Student's t with :math:`\nu` degrees of freedom, as errors
have heavier tails than their covariances say, and a share w of poses that are wrong altogether. The scale s, ν and w
are fitted to poses located along validation drives, as is how many false alarms a located pose may have
(:meth:`MetricErrors.fitted`). An image that is not located tells nothing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.optimize import minimize
from scipy.special import gammaincinv
from torch import Tensor

from sextant.geometry.planar import wrap_angle
from sextant.localization.observation.evidence import Evidence, check_runs
from sextant.shapes import check_shape

#: located validation images below which the errors are not fitted
LEAST_FITTED = 20
#: errors assumed then: covariances as they are, tails of a t distribution with three degrees, a tenth wrong
UNFITTED = (1.0, 3.0, 0.1)
#: limits of the decimal logarithm of the number of false alarms that are tried; the first is that of PoseMap, and above
#: the last chance alone finds such poses
LIMITS = (-100.0, -50.0, -30.0, -20.0, -10.0, -5.0, 0.0)
#: largest degrees of freedom: a t distribution is then normal to within a few per cent
NORMAL = 50.0


def planar_pose(
    world_from_camera: Float64[ndarray, "4 4"], covariance: Float64[ndarray, "6 6"]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3 3"]]:
    r"""The pose in the plane of a camera that looks ahead, and its covariance, whatever the height, tilt and roll.

    The heading is that of the viewing direction :math:`R e_3`, which a rotation :math:`\delta` in the axes of the
    camera changes by :math:`R (\delta \times e_3)`.

    Args:
        world_from_camera: x right, y down, z forward; the world's z points up.
        covariance: of a displacement and a rotation in the axes of the camera.

    Returns:
        x, y and heading in rad, and their covariance.

    Example:
        >>> east = np.array([[0.0, 0, 1, 3], [-1, 0, 0, 4], [0, -1, 0, 0.9], [0, 0, 0, 1]])  # at (3, 4), ahead is x
        >>> pose, covariance = planar_pose(east, np.diag([1.0, 2, 3, 4, 5, 6]))
        >>> pose.tolist(), covariance.diagonal().tolist()  # ahead, to the side, and about the camera's y
        ([3.0, 4.0, 0.0], [3.0, 1.0, 5.0])
    """
    rotation, ahead = world_from_camera[:3, :3], world_from_camera[:3, 2]
    jacobian = np.zeros((3, 6))
    jacobian[:2, :3] = rotation[:2]
    turned = rotation[:2] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    jacobian[2, 3:] = (ahead[0] * turned[1] - ahead[1] * turned[0]) / max(float(ahead[:2] @ ahead[:2]), 1e-12)
    pose = np.array([*world_from_camera[:2, 3], math.atan2(ahead[1], ahead[0])])
    return pose, jacobian @ covariance @ jacobian.T


def pose_volume(poses: Float64[ndarray, "n 3"]) -> float:
    """The volume of the poses about those of a map: the area of their bounding box, a metre wider, times a turn.

    Example:
        >>> round(pose_volume(np.array([[0.0, 0, 0], [3, 1, 0]])) / math.tau, 3)  # 5 m by 3 m
        15.0
    """
    sides = np.ptp(poses[:, :2], axis=0) + 2.0
    return float(sides[0] * sides[1] * math.tau)


@dataclass(frozen=True)
class MetricErrors:
    """How located poses err.

    Attributes:
        scale: s, by which standard deviations are multiplied.
        dof: ν.
        wrong: w.
        volume: V, in square units of the map times rad.
        limit: the largest decimal logarithm of the number of false alarms of a pose that counts as located.
    """

    scale: float
    dof: float
    wrong: float
    volume: float
    limit: float = LIMITS[0]

    @classmethod
    def fitted(
        cls,
        errors: Float64[ndarray, "n 3"],
        covariances: Float64[ndarray, "n 3 3"],
        volume: float,
        alarms: Float64[ndarray, "n"] | None = None,
    ) -> "MetricErrors":
        """The likeliest scale, degrees of freedom and share of wrong poses, and with ``alarms`` the most telling limit.

        The limit is the one of :data:`LIMITS` with the largest sum of log-likelihoods over all images, of which those
        that are not located count 0: a wider limit locates more of them, but more wrongly.

        Args:
            errors: of located poses in x, y and heading (rad).
            covariances: of these.
            volume: V, of the map that they were located in.
            alarms: decimal logarithms of their numbers of false alarms; None: all count as located.

        Example:
            >>> errors = np.random.default_rng(0).normal(size=(500, 3)) * 0.02
            >>> errors[:50] += 5.0  # a tenth is wrong
            >>> found = MetricErrors.fitted(errors, np.tile(np.eye(3) * 1e-4, (500, 1, 1)), 1000.0)
            >>> round(found.scale), round(found.wrong, 2)  # errors are twice as large as stated
            (2, 0.1)
        """
        if alarms is not None:
            best, most = cls(*UNFITTED, volume), 0.0
            for limit in LIMITS:
                some = alarms <= limit
                if some.sum() >= LEAST_FITTED:
                    found = replace(cls.fitted(errors[some], covariances[some], volume), limit=limit)
                    of, stated = torch.from_numpy(errors[some])[:, None], torch.from_numpy(covariances[some])
                    total = float(found.log_likelihood(of, stated).sum())
                    best, most = (found, total) if total > most else (best, most)
            return best
        scale, dof, wrong = UNFITTED
        if len(errors) < LEAST_FITTED:
            return cls(scale, dof, wrong, volume)
        of, stated = torch.from_numpy(errors)[:, None], torch.from_numpy(covariances)

        def loss(values: ndarray) -> float:
            return -float(cls._of(values, volume).log_likelihood(of, stated).mean())

        start = np.array([math.log(scale), math.log(dof), math.log(wrong / (1 - wrong))])
        bounds = [
            (math.log(0.1), math.log(100)),
            (0.0, math.log(NORMAL)),
            (-7.0, 0.0),
        ]  # a thousandth to half are wrong
        least = minimize(loss, start, method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-3, "fatol": 1e-5})
        return cls._of(least.x, volume)

    @classmethod
    def _of(cls, values: ndarray, volume: float) -> "MetricErrors":
        scale, dof, odds = np.exp(values).tolist()
        return cls(scale, dof, odds / (1 + odds), volume)

    def log_likelihood(
        self, error: Float64[Tensor, "r p 3"], covariance: Float64[Tensor, "r 3 3"]
    ) -> Float64[Tensor, "r p"]:
        """The equation of the module, of p errors of each of r located poses."""
        right = self.log_density(error, covariance) + math.log1p(-self.wrong) + math.log(self.volume)
        return torch.logaddexp(right, right.new_tensor(math.log(self.wrong)))

    def log_density(
        self, error: Float64[Tensor, "r p 3"], covariance: Float64[Tensor, "r 3 3"]
    ) -> Float64[Tensor, "r p"]:
        r""":math:`\log t_\nu` of a pose that is not wrong; headings a turn apart are the same."""
        factor = self.scale * torch.linalg.cholesky(covariance)
        log_volume = factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)[:, None]
        constant = math.lgamma((self.dof + 3) / 2) - math.lgamma(self.dof / 2) - 1.5 * math.log(self.dof * math.pi)
        error = torch.cat([error[..., :2], wrap_angle(error[..., 2:])], -1)
        turns = error.new_tensor([[0.0, 0.0, turn * 2 * math.pi] for turn in (-1, 0, 1)])
        white = torch.linalg.solve_triangular(
            factor[:, None], (error[..., None, :] + turns).transpose(-1, -2), upper=False
        )
        told = torch.log1p(white.square().sum(-2) / self.dof) * (-(self.dof + 3) / 2)
        found: Tensor = told.logsumexp(-1) + constant - log_volume
        return found

    def draw(
        self, covariance: Float64[Tensor, "r 3 3"], count: int, generator: torch.Generator
    ) -> Float64[Tensor, "r count 3"]:
        """Errors of poses that are not wrong."""
        shape = (len(covariance), count)
        normal = torch.randn(*shape, 3, generator=generator, dtype=covariance.dtype)
        # chi-square by inversion, as torch.distributions takes no generator
        uniform = torch.rand(shape, generator=generator, dtype=covariance.dtype)
        squared = 2 * _inverse_gamma(self.dof / 2, uniform)
        tails: Tensor = (self.dof / squared).sqrt()
        drawn: Tensor = normal @ torch.linalg.cholesky(covariance).mT
        return self.scale * tails[..., None] * drawn


def _inverse_gamma(shape: float, uniform: Tensor) -> Tensor:
    return torch.from_numpy(np.maximum(gammaincinv(shape, uniform.numpy()), 1e-300))


@dataclass(frozen=True)
class MetricPoses:
    """The located poses of one image in each of r runs.

    Attributes:
        poses: x, y and heading; meaningless where it is not located.
        covariances: of these.
        located: whether the image was located.
        errors: how such poses err.
    """

    poses: Float64[Tensor, "r 3"]
    covariances: Float64[Tensor, "r 3 3"]
    located: Bool[Tensor, "r"]
    errors: MetricErrors

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """The log-likelihood of the located poses at each run's poses; 0 where it is not located."""
        check_runs(poses, len(self.poses), "located pose")
        told = self.errors.log_likelihood(self.poses[:, None] - poses, self.covariances)
        return torch.where(self.located[:, None], told, 0.0)


class EvidenceWithPose(Evidence):
    """Evidence of an image with that of its located pose, given which the image's descriptor is independent.

    Args:
        evidence: of the descriptor.
        measured: the located pose.
        weighs: whether the pose weighs; if not, it only proposes
            (:class:`~sextant.localization.recovery.MetricProposal`).
    """

    def __init__(self, evidence: Evidence, measured: MetricPoses, weighs: bool = True):
        self.evidence, self.measured, self.weighs = evidence, measured, weighs

    def restricted(self, to: Callable[[Evidence], Evidence]) -> Evidence:
        """Restrict the descriptor's evidence alone: a located pose also tells off the map."""
        return EvidenceWithPose(to(self.evidence), self.measured, self.weighs)

    def log_likelihood(self, poses: Float64[Tensor, "r p 3"]) -> Float64[Tensor, "r p"]:
        """See :class:`~sextant.localization.observation.Evidence`."""
        told = self.evidence.log_likelihood(poses)
        return told + self.measured.log_likelihood(poses) if self.weighs else told

    def over_map(self) -> Float64[Tensor, "r n"]:
        """That of the descriptor: images of the map seldom lie within centimetres of a located pose."""
        return self.evidence.over_map()


@dataclass(frozen=True, eq=False)
class DrivePoses:
    """The located poses of the frames of a drive.

    Attributes:
        poses, covariances, located: as of :class:`MetricPoses`, one a frame.
        errors: how they err.
        weighs: whether they weigh, besides proposing.

    Raises:
        ArgumentError: there is not one pose, covariance and flag for each frame.
    """

    poses: Float64[ndarray, "n 3"]
    covariances: Float64[ndarray, "n 3 3"]
    located: Bool[ndarray, "n"]
    errors: MetricErrors
    weighs: bool = True

    def __post_init__(self) -> None:
        check_shape("poses", self.poses, "n", 3)
        check_shape("covariances", self.covariances, len(self.poses), 3, 3)
        check_shape("located", self.located, len(self.poses))

    def beside(self, evidence: Evidence, frames: ndarray) -> EvidenceWithPose:
        """The evidence of frames, with their located poses."""
        poses, covariances, located = (
            torch.from_numpy(each[frames]) for each in (self.poses, self.covariances, self.located)
        )
        return EvidenceWithPose(evidence, MetricPoses(poses, covariances, located, self.errors), self.weighs)
