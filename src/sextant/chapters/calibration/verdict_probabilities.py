"""The probabilities that the joint camera of a photo is right, by the fitted model of its errors."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.chapters.calibration.error_model import COVARIATES, ErrorModel, standardised
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.jointly import MULTIPLES, network_sigmas

#: the numbers that the model describes: tilt and roll in radians, the log of the focal length
NUMBERS = ("tilt", "roll", "focal length")
#: errors within which an answer is right, and beyond which it is wrong
RIGHT = (math.radians(3), math.radians(2), math.log(1.1))
WRONG = (math.radians(6), math.radians(4), math.log(1.2))
#: the fitted numbers, written by ``python -m benchmarks.joint_verdicts``
FITTED = Path(__file__).with_name("verdicts.json")


@dataclass(frozen=True)
class Verdicts:
    """The fitted models of errors, and the threshold of the verdict *good*.

    Attributes:
        models: of each of :data:`NUMBERS`.
        good: least probability that all of them are right, for which a camera is good.
    """

    models: tuple[ErrorModel, ErrorModel, ErrorModel]
    good: float

    def within(
        self, limits: tuple[float, float, float], sigma: Float64[ndarray, "n 3"], covariates: Float64[ndarray, "n 3 k"]
    ) -> Float64[ndarray, "n 3"]:
        """Probabilities that the errors of n cameras are within the limits."""
        columns = zip(self.models, limits, sigma.T, covariates.swapaxes(0, 1), strict=True)
        return np.stack([model.within(limit, own, others) for model, limit, own, others in columns], axis=1)

    def of(self, finding: Finding, limits: tuple[float, float, float]) -> Float64[ndarray, "3"]:
        """Probabilities that the errors of a joint camera of one photo by itself are within the limits."""
        sigma, covariates = evidence_on_errors(finding)
        return np.asarray(self.within(limits, sigma[None], covariates[None])[0])

    def row(self) -> dict[str, Any]:
        """The fitted numbers by name."""
        return {"good": self.good, **{n: model.row() for n, model in zip(NUMBERS, self.models, strict=True)}}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> "Verdicts":
        """The verdicts of :meth:`row`."""
        tilt, roll, focal = (ErrorModel.of_row(row[name]) for name in NUMBERS)
        return cls((tilt, roll, focal), float(row["good"]))


@cache
def fitted_verdicts() -> Verdicts:
    """The verdicts that the package comes with."""
    return Verdicts.of_row(json.loads(FITTED.read_text()))


def evidence_on_errors(finding: Finding) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3 k"]]:
    """Standard errors by curvature of tilt, roll and log focal length of a joint finding, and the covariates of each.

    Raises:
        ValueError: the finding is not of one photo by itself, from its lines and the package's network.
    """
    said, joint, lines = finding.network, finding.joint, finding.lines
    if said is None or joint is None or lines is None:
        raise ValueError(f"{finding.name} is no joint camera of one photo by itself")
    focal, network = float(finding.camera.focal), float(said.camera.focal)
    per_vfov = (4 * focal**2 + 1) / (4 * focal)  # |d ln f / d vfov|
    sigma = finding.half["68"][:3] / MULTIPLES["68"][:3] * [1, 1, per_vfov]
    theirs = network_sigmas(said)[:3]
    off = [
        float(finding.camera.tilt - said.camera.tilt),
        float(finding.camera.roll - said.camera.roll),
        2 * (math.atan(0.5 / focal) - math.atan(0.5 / network)),
    ]
    bent = float(finding.camera.k1) / focal**2 * (finding.side / finding.view.height) ** 2
    values = {
        "explained": np.full(3, lines.explained),
        "support": np.full(3, math.log1p(sorted(joint.support)[1])),
        "disagreement": np.log1p(np.abs(off) / theirs),
        "network": np.log(theirs),
        "distortion": np.full(3, math.log(0.02 + abs(bent))),
    }
    assert values.keys() == COVARIATES.keys()
    return sigma, standardised(values)
