"""A trained network, as far as the calibration of photos needs it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from torch import Tensor

from sextant.geometry import CameraParameters, K2Family

if TYPE_CHECKING:
    from sextant.tasks.calibration.module import Calibration, CalibrationPrediction


@runtime_checkable
class CalibrationModel(Protocol):
    """A trained network, as far as prediction needs it.

    Attributes:
        input_width, input_height: of the images it takes.
        aspects: of the images it was trained on, before they were squashed.
        spread: half the width of the central 68 % of tilt, roll, vfov (radians) and k1_hat that it was trained on.
        k2_of_k1: its lens family.
    """

    @property
    def input_width(self) -> int: ...  # noqa: D102
    @property
    def input_height(self) -> int: ...  # noqa: D102
    @property
    def aspects(self) -> Sequence[float]: ...  # noqa: D102
    @property
    def spread(self) -> Sequence[float]: ...  # noqa: D102
    @property
    def k2_of_k1(self) -> K2Family: ...  # noqa: D102

    def predict(self, images: Tensor, aspect: Tensor) -> "CalibrationPrediction":
        """Cameras of images of bytes ``(b, 3, h, w)``."""

    def position(self, camera: CameraParameters) -> Tensor:
        """Where each of the four numbers lies along the range trained on, ``(b, 4)``: 0 to 1 inside it."""


class TrainedModel:
    """A calibration module as a :class:`CalibrationModel`."""

    def __init__(self, module: "Calibration"):
        self.module = module.eval()
        spec = module.spec
        self.input_width, self.input_height, self.aspects, self.spread = (
            spec.width, spec.height, spec.aspects, spec.spread,
        )  # fmt: skip
        self.k2_of_k1: K2Family = module.parameterization.k2_of_k1

    def predict(self, images: Tensor, aspect: Tensor) -> "CalibrationPrediction":
        """Cameras of images of bytes, on the module's device."""
        return self.module.predict(images.to(self.module.device), aspect.to(self.module.device))

    def position(self, camera: CameraParameters) -> Tensor:
        """Where each of the four numbers lies along its range."""
        return self.module.space.to_unit(self.module.parameterization.encode(camera))
