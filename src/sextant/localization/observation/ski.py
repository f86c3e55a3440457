r"""Structured kernel interpolation: the kernel between any poses, interpolated from a grid.

.. math:: k(x, x') \approx w(x)^\top K_G\, w(x'), \qquad A = W K_G W^\top + s_n^2 I, \qquad
   \mu(x) = m + w(x)^\top \underbrace{K_G W^\top A^{-1} \bar Y}_{\text{grid}}, \qquad
   s^2(x) = w^\top K_G w - \|w(x)^\top \underbrace{K_G W^\top R}_{\text{grid}}\|^2 + s_n^2

with cubic weights w, 64 a pose. :math:`A^{-1} \bar Y` comes from conjugate gradients, for all outputs at once, and
:math:`A^{-1} \approx R R^\top` of rank T from the Lanczos process. Both take products with A, which cost O(n + G) for G
nodes. The Lanczos root is incomplete, :math:`R R^\top \preceq A^{-1}`, so variances are conservative, and less so the
higher T. A prediction costs 64 (D + T), whatever the size of the map.

GPyTorch's own ``GridInterpolationKernel`` would put the heading on an interval that does not wrap, and keeps a copy of
the kernel for each output. Its solvers from ``linear_operator`` are used here on the grid of
:mod:`~sextant.localization.observation._pose_grid`.

Sources: A. G. Wilson and H. Nickisch, "Kernel interpolation for scalable structured Gaussian processes (KISS-GP)", ICML
2015; G. Pleiss, J. Gardner, K. Weinberger, A. G. Wilson, "Constant-time predictive distributions for Gaussian processes
(LOVE)", ICML 2018. The preconditioner is a Nyström approximation of A at a few inducing poses: K. Cutajar, M. Osborne,
J. Cunningham, M. Filippone, "Preconditioning kernel matrices", ICML 2016.
"""

import warnings
from collections.abc import Callable
from typing import Annotated

import torch
from annotated_types import Ge, Gt, Le
from jaxtyping import Float32, Float64
from linear_operator.utils import linear_cg
from linear_operator.utils.lanczos import lanczos_tridiag
from linear_operator.utils.warnings import NumericalWarning
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.localization.observation._factor import check_noise
from sextant.localization.observation._inducing import factor_of, inducing_poses
from sextant.localization.observation._pose_grid import PoseGrid
from sextant.localization.observation.model import ObservationModel, Prediction, stored
from sextant.ranges import Seed, checked

#: Relative residual at which the solver stops.
TOLERANCE = 1e-5
MAX_ITERATIONS = 2000
#: Number of inducing poses of the preconditioner.
PRECONDITIONER = 200
#: Largest number of nodes of a grid: 0.5 GB for 128 outputs.
MAX_NODES = 2**20
LEAST = 1e-12


class SKI(ObservationModel):
    """A Gaussian process on a grid. Only for the ``rbf`` kernel, which is a product over dimensions.

    Args:
        spacing: spacing of the grid's nodes in lengths of the kernel, in (0, 1].
        rank: T, the rank of the inverse root that variances come from; at most the number of images is used.
        seed: seed of the start vector of the Lanczos process and of the preconditioner.

    Raises:
        UserError: the spacing or the rank is outside its range.

    Example:
        >>> from sextant.localization.descriptor_map import DescriptorMap
        >>> from sextant.localization.observation import ExactGP
        >>> from sextant.localization.pose_kernel import PoseKernel
        >>> poses = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.rand(20, 4)), PoseKernel("rbf", (3.0, 3.0), 1.0, 1.0, 0.1)
        >>> exact, grid = (model.fit(places, kernel).predict(poses).mean for model in (ExactGP(), SKI()))
        >>> (grid - exact).abs().max() < 0.02
        tensor(True)
    """

    grid_mean: Float32[Tensor, "g d"]
    grid_root: Float32[Tensor, "g t"]

    @checked
    def __init__(
        self, spacing: Annotated[float, Gt(0), Le(1)] = 0.5, rank: Annotated[int, Ge(2)] = 200, seed: Seed = 0
    ):
        self.spacing, self.rank, self.seed = spacing, rank, seed

    def _fit(self) -> None:
        check_noise(self.kernel, type(self).__name__)
        self._make_grid()
        weights, _ = self._grid.interpolation(self.map.poses)
        transposed = weights.T.tocsr()

        def spread(columns: Tensor) -> Tensor:
            return torch.from_numpy(self._grid.times_kernel(transposed @ columns.numpy()))

        def covariance(columns: Tensor) -> Tensor:
            signal = torch.from_numpy(weights @ spread(columns).numpy())
            return signal + self.kernel.noise_variance * columns

        self.grid_mean = spread(self._solve(covariance)).float().contiguous()
        self.grid_root = spread(self._inverse_root(covariance)).float().contiguous()

    def _make_grid(self) -> None:
        if self.kernel.spatial != "rbf":
            raise UserError(
                f"kernel.spatial={self.kernel.spatial} is not a product over x and y, which a grid needs",
                "Set kernel=rbf, or choose another observation, such as cached_local.",
            )
        self._grid = PoseGrid.of(self.map.poses, self.kernel, self.spacing)
        if self._grid.nodes > MAX_NODES:
            raise ArgumentError(
                f"spacing={self.spacing} makes a grid of {self._grid.nodes:,} poses over this map; at most "
                f"{MAX_NODES:,} are allowed",
                "Raise spacing, or choose CachedLocalGP, which does not grow with the area.",
            )

    def _solve(self, covariance: Callable[[Tensor], Tensor]) -> Tensor:
        right = (self.map.descriptors - self.map.mean).double()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NumericalWarning)  # the residual itself is checked below
            solution: Tensor = linear_cg(
                covariance,
                right,
                tolerance=TOLERANCE,
                max_iter=MAX_ITERATIONS,
                max_tridiag_iter=0,
                preconditioner=self._preconditioner(),
            )
        left = torch.linalg.vector_norm(covariance(solution) - right) / torch.linalg.vector_norm(right).clamp(
            min=1e-300
        )
        if not left < 100 * TOLERANCE:
            raise UserError(
                f"the solver of SKI stopped at a relative residual of {left:.1g} after {MAX_ITERATIONS} steps",
                "Raise kernel.noise_variance, or choose another observation.",
            )
        return solution

    def _preconditioner(self) -> Callable[[Tensor], Tensor]:
        noise = self.kernel.noise_variance
        few = inducing_poses(self.map, self.kernel, min(PRECONDITIONER, len(self.map)), "kmeans", self.seed)
        factor = factor_of(self.kernel, few)
        features = torch.linalg.solve_triangular(factor, self.kernel(few, self.map.poses), upper=False)
        inner = torch.linalg.cholesky(noise * torch.eye(len(few), dtype=torch.float64) + features @ features.T)
        return lambda columns: (columns - features.T @ torch.cholesky_solve(features @ columns, inner)) / noise

    def _inverse_root(self, covariance: Callable[[Tensor], Tensor]) -> Tensor:
        n = len(self.map)
        if n < 2:
            only = covariance(torch.ones(1, 1, dtype=torch.float64))
            return only.rsqrt()
        start = torch.randn(n, 1, generator=torch.Generator().manual_seed(self.seed), dtype=torch.float64)
        vectors, tridiagonal = lanczos_tridiag(
            covariance, min(self.rank, n), torch.float64, start.device, (n, n), init_vecs=start
        )
        factor = torch.linalg.cholesky(tridiagonal)
        root: Tensor = torch.linalg.solve_triangular(factor, vectors.T, upper=False).T
        return root

    def predict(self, poses: Float64[Tensor, "n 3"]) -> Prediction:
        """See :class:`ObservationModel`. More than three lengths beyond the map, the prediction is the prior."""
        weights, prior = self._grid.interpolation(poses)
        weights = weights.astype("float32")
        mean = torch.from_numpy(weights @ self.grid_mean.numpy()).double()
        explained = torch.from_numpy(weights @ self.grid_root.numpy()).double().square().sum(1)
        left = (prior - explained).clamp(min=LEAST * self.kernel.signal_variance)
        return Prediction(self.map.mean + mean, left + self.kernel.noise_variance)

    def state(self) -> dict[str, Tensor]:
        """See :class:`ObservationModel`."""
        return {"grid_mean": self.grid_mean, "grid_root": self.grid_root}

    def _load(self, state: dict[str, Tensor]) -> None:
        self._make_grid()
        rank = state["grid_root"].shape[-1] if "grid_root" in state else 0
        self.grid_mean = stored(state, "grid_mean", (self._grid.nodes, self.map.dimension), torch.float32)
        self.grid_root = stored(state, "grid_root", (self._grid.nodes, rank), torch.float32)
