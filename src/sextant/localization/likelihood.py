r"""The likelihood of a descriptor given a map's prediction at a pose.

With the squared distance :math:`q = \|z - \mu(x)\|^2` to the predicted mean, its variance
:math:`v = s^2(x) + s_a^2`, the same in all D dimensions, and an inverse temperature :math:`\beta`:

.. math:: \text{full:}\quad       & \beta \left[-\tfrac D2 \log(2\pi v) - \tfrac{q}{2v}\right] \\
   \text{univariate:}\quad & \beta \left[-\tfrac 12 \log(2\pi v) - \tfrac{q}{2v}\right] \\
   \text{student:}\quad    & \beta \left[\log\frac{\Gamma(\frac{\nu + D}2)}{\Gamma(\frac\nu2)}
   - \tfrac D2 \log(\nu\pi v) - \tfrac{\nu + D}2 \log\!\left(1 + \tfrac{q}{\nu v}\right)\right]

``full`` is the Gaussian density of the descriptor, and ``student`` that of the multivariate t distribution with scale
v. ``univariate`` is not a density of the descriptor: it treats its distance from the mean as one Gaussian number, and
so penalizes uncertain poses less. All are overconfident if errors are correlated across dimensions or the appearance of
the world has changed, which :math:`\beta < 1` and the appearance variance :math:`s_a^2` correct.

Sources: the univariate form is that of the public code AppearanceSeqMCL of A. Jaenal; on why peaked likelihoods starve
a particle filter, P. Pfaff, W. Burgard, D. Fox, "Robust Monte-Carlo localization using adaptive likelihood models",
European Robotics Symposium 2006.
"""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float64
from torch import Tensor

Form = Literal["full", "univariate", "student"]
FORMS: tuple[Form, ...] = ("full", "univariate", "student")


@dataclass(frozen=True)
class Likelihood:
    """A form of likelihood with its calibration.

    Attributes:
        form: one of the module's equations.
        tempering: :math:`\\beta` in (0, 1], the number of independent observations that one image is worth.
        appearance_variance: :math:`s_a^2`, the variance of one dimension between the seasons of map and query; or a
            column of them, one for each run.
        dof: degrees of freedom :math:`\\nu` of the Student form; the others ignore it.

    Example:
        >>> squared, variance = torch.tensor([0.0, 8.0]).double(), torch.ones(2).double()
        >>> for likelihood in (Likelihood(), Likelihood(tempering=0.5), Likelihood(appearance_variance=3.0)):
        ...     told = likelihood.log_prob(squared, variance, dimension=128)
        ...     print(f"{told[0] - told[1]:.1f} nats")  # calibration reduces the effect of a distance
        4.0 nats
        2.0 nats
        1.0 nats
    """

    form: Form = "full"
    tempering: float = 1.0
    appearance_variance: float | Float64[Tensor, "r 1"] = 0.0
    dof: float = 4.0

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise ValueError(f"form={self.form!r} must be one of {', '.join(FORMS)}")
        if not 0 < self.tempering <= 1:
            raise ValueError(f"tempering={self.tempering} must be in (0, 1]")
        variance = self.appearance_variance
        low, high = variance.aminmax() if isinstance(variance, Tensor) else (variance, variance)
        if not (low >= 0 and high < math.inf):
            raise ValueError(f"appearance_variance={self.appearance_variance} must be at least 0 and finite")
        if not (self.dof > 0 and math.isfinite(self.dof)):
            raise ValueError(f"dof={self.dof} must be above 0 and finite")

    def log_prob(
        self, squared: Float64[Tensor, "*#s"], variance: Float64[Tensor, "*#s"], dimension: int
    ) -> Float64[Tensor, "*#s"]:
        """The log-likelihood in nats; shapes are broadcast.

        Args:
            squared: squared distance between descriptor and predicted mean.
            variance: predicted variance of one dimension, noise included; the appearance variance is added here.
            dimension: D, the number of values in a descriptor.
        """
        variance = variance + self.appearance_variance
        if self.form == "student":
            return self.tempering * self._student(squared, variance, dimension)
        size = dimension if self.form == "full" else 1
        return (-0.5 * self.tempering) * (size * torch.log(2 * math.pi * variance) + squared / variance)

    def _student(self, squared: Tensor, variance: Tensor, dimension: int) -> Tensor:
        together = (self.dof + dimension) / 2
        constant = math.lgamma(together) - math.lgamma(self.dof / 2) - dimension / 2 * math.log(self.dof * math.pi)
        spread = torch.log1p(squared / (self.dof * variance))
        return constant - dimension / 2 * torch.log(variance) - together * spread
