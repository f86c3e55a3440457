"""The camera network: images to cameras with their expected errors, built from a config or from a checkpoint."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.chapters.calibration.metrics.picture_looks import NUMBERS, LooksSpread, own_distances, picture_looks
from sextant.config.building import build
from sextant.config.trained import without_weights
from sextant.errors import ArgumentError, UserError
from sextant.evaluation.conformal import conformal_quantile
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, vfov_from_focal
from sextant.geometry.canvas import of_picture, on_canvas
from sextant.geometry.field_fit import fit_field
from sextant.kit.trained import load_weights, own_config
from sextant.models import CalibrationNet, CalibrationOutput
from sextant.models.calibration_net import cell_centres
from sextant.models.canvas import pictures_of_canvas
from sextant.runs.checkpoint import KEY
from sextant.torch_file import building

#: share of validation images that count as typical
USUAL = 0.95
#: parameterizations that can represent any camera, however steep
WITH_FIELD = ("angles", "direct")


@dataclass(frozen=True)
class CalibrationSpec:
    """The inputs and output ranges of a trained network: with the weights, all that prediction needs.

    Attributes:
        height: height of the input in pixels.
        width: width of the input in pixels.
        aspects: width over height of the training images, before they were resized to the input.
        low: lower ends of the four ranges.
        high: upper ends of the four ranges.
        validation_crops: number of scores on which the intervals are based.
        per_panorama: number of scores from each panorama.
        median: tilt, roll, focal and k1 in the middle of the training distribution.
        spread: half-width of the central 68 % of tilt, roll, vfov (radians) and k1_hat in training.
        canvas: the input is a square with the picture in its middle (:mod:`sextant.geometry.canvas`), and the ranges
            are those of cameras on it; otherwise the picture is squashed to the input.
    """

    height: int
    width: int
    aspects: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    validation_crops: int
    per_panorama: int
    median: tuple[float, ...]
    spread: tuple[float, ...]
    canvas: bool = False

    def space(self, parameterization: Parameterization) -> ParameterSpace:
        """The numbers that the network predicts, and their ranges."""
        return ParameterSpace(parameterization, torch.tensor(self.low), torch.tensor(self.high))


@dataclass(frozen=True)
class CalibrationPrediction:
    """Predicted cameras with their uncertainty.

    Attributes:
        parameters: the cameras.
        scale: expected absolute error of tilt, roll, vfov (radians) and k1_hat.
        scores: ratios of error to expected error on the validation split, one column each.
        per_panorama: validation crops of each panorama.
        strangeness: distance of each image's appearance from the validation images, in units of their 95 % quantile;
            0 if that is unknown, None if not computed.
    """

    parameters: CameraParameters
    scale: Float[Tensor, "b 4"]
    scores: Float[Tensor, "n 4"]
    per_panorama: int = 1
    strangeness: Float[Tensor, "b"] | None = None

    def quantile(self, level: float) -> Float[Tensor, "4"]:
        """Multipliers of ``scale`` that make intervals which cover the truth in a share ``level`` of images."""
        return conformal_quantile(self.scores, level, self.per_panorama)


def reported(camera: CameraParameters) -> Float[Tensor, "*b 4"]:
    """The quantities with intervals, whatever is predicted: tilt, roll, vfov (radians) and apparent distortion."""
    return torch.stack([camera.tilt, camera.roll, vfov_from_focal(camera.focal), camera.k1 / camera.focal.square()], -1)


class CameraNetwork(nn.Module):
    """Predicts cameras of images, with the uncertainty of each parameter.

    Args:
        network: predicts the four numbers along their ranges, and the expected errors.
        spec: sizes and ranges.
        parameterization: what the four numbers are.
    """

    scores: Tensor
    looks_mean: Tensor
    looks_whitening: Tensor
    looks_scores: Tensor

    def __init__(self, network: CalibrationNet, spec: CalibrationSpec, parameterization: Parameterization):
        super().__init__()
        self.network, self.spec = network, spec
        self.parameterization, self.space = parameterization, spec.space(parameterization)
        self.register_buffer("scores", torch.full((spec.validation_crops, 4), torch.inf))
        self.register_buffer("looks_mean", torch.zeros(NUMBERS))
        self.register_buffer("looks_whitening", torch.zeros(NUMBERS, NUMBERS))
        self.register_buffer("looks_scores", torch.full((spec.validation_crops,), torch.inf))

    def forward(
        self, images: Float[Tensor, "b 3 h w"], aspect: Float[Tensor, "b"]
    ) -> tuple[CameraParameters, Float[Tensor, "b 4"]]:
        """Cameras of images in [0, 1], and the expected absolute errors of the quantities of :func:`reported`.

        On a canvas, this is the mean of the cameras of an image and of its mirror image, in which only roll changes
        sign.
        """
        if not self.spec.canvas:
            output = self.network(images, aspect)
            return self.camera(output, None, aspect), output.log_scale.exp()
        twice = aspect.repeat(2)
        output = self.network(torch.cat([images, images.flip(-1)]), twice)
        both = self.camera(output, self.fitted(output, twice), twice)
        tilt, roll, focal, k1 = (value.reshape(2, -1) for value in both)
        camera = CameraParameters(tilt.mean(0), (roll[0] - roll[1]) / 2, focal.log().mean(0).exp(), k1.mean(0))
        return camera, output.log_scale.exp().reshape(2, -1, 4).mean(0)

    def camera(
        self, output: CalibrationOutput, fitted: CameraParameters | None, aspect: Float[Tensor, "b"]
    ) -> CameraParameters:
        """The cameras of pictures: those fitted to a field, or those of the heads where none are."""
        return self.decoded(self.space.from_unit(output.unit), aspect) if fitted is None else of_picture(fitted, aspect)

    def fitted(self, output: CalibrationOutput, aspect: Float[Tensor, "b"]) -> CameraParameters | None:
        """The cameras on the canvas that fit the network's field best; None if it predicts no field."""
        if output.believed is None:
            return None
        start = self.parameterization.decode(self.space.from_unit(output.unit))
        points, seen = self.cell_centres(aspect)
        fitted = fit_field(start, output.believed, points, seen, self.parameterization.k2_of_k1)
        return fitted.to(dtype=output.unit.dtype)

    def cell_centres(self, aspect: Float[Tensor, "b"]) -> tuple[Float[Tensor, "b n 2"], Bool[Tensor, "b n"]]:
        """Where the points of a field are on the canvas, and which show the picture."""
        assert self.network.field is not None
        return cell_centres(self.network.field.cells, aspect)

    def looks(self, images: Float[Tensor, "b 3 h w"], aspect: Float[Tensor, "b"]) -> Float[Tensor, "b 16"]:
        """Appearance statistics of images in [0, 1], by :func:`picture_looks`."""
        if self.network.lines is None:
            return picture_looks(images)
        pictures = pictures_of_canvas(images, aspect, self.network.lines)
        return torch.cat([picture_looks(picture) for picture in pictures])

    def decoded(self, values: Float[Tensor, "b 4"], aspect: Float[Tensor, "b"]) -> CameraParameters:
        """Cameras of pictures from the four numbers of each."""
        camera = self.parameterization.decode(values)
        return of_picture(camera, aspect) if self.spec.canvas else camera

    def encoded(self, camera: CameraParameters, aspect: Float[Tensor, "b"]) -> Float[Tensor, "b 4"]:
        """The four numbers that describe the cameras of pictures."""
        return self.parameterization.encode(on_canvas(camera, aspect) if self.spec.canvas else camera)

    @torch.no_grad()
    def predict(self, images: Tensor, aspect: Float[Tensor, "b"]) -> CalibrationPrediction:
        """Cameras with their uncertainty, and the strangeness, of images of bytes ``(b, 3, h, w)``."""
        images, aspect = images.to(self.scores.device).float() / 255, aspect.to(self.scores.device)
        camera, scale = self(images, aspect)
        looks = self.looks(images, aspect)
        usual = conformal_quantile(self.looks_scores, USUAL, self.spec.per_panorama)
        distance = LooksSpread(self.looks_mean, self.looks_whitening).distance(looks)
        return CalibrationPrediction(camera, scale, self.scores, self.spec.per_panorama, distance / usual)

    def position(self, camera: CameraParameters, aspect: Float[Tensor, "b"]) -> Float[Tensor, "b 4"]:
        """The position of each of a camera's four numbers along the range trained on: 0 to 1 inside it."""
        return self.space.to_unit(self.encoded(camera, aspect))

    def keep_validation(self, scores: Float[Tensor, "n 4"], looks: Float[Tensor, "n 16"], panoramas: Tensor) -> None:
        """Keep the data on which intervals and strangeness are based.

        Crops that were not validated, as with ``debug=one_batch``, count as those with infinite scores.

        Args:
            scores: ratios of error to expected error on the validation split.
            looks: of its images, by :func:`~sextant.chapters.calibration.metrics.picture_looks.picture_looks`.
            panoramas: the panorama that each image was cut from.
        """
        self.scores.fill_(torch.inf)[: len(scores)] = scores
        self.looks_scores.fill_(torch.inf)[: len(looks)] = own_distances(looks, panoramas)
        if len(looks) > 1:
            spread = LooksSpread.fit(looks)
            self.looks_mean.copy_(spread.mean)
            self.looks_whitening.copy_(spread.whitening)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        for name in ("looks_mean", "looks_whitening", "looks_scores"):  # missing in older runs
            state_dict.setdefault(prefix + name, getattr(self, name))
        head = prefix + "network.field."
        if self.network.field is not None and not any(name.startswith(head) for name in state_dict):
            # a run continued from one without a field learns it anew
            state_dict |= {head + name: value for name, value in self.network.field.state_dict().items()}
        for name in ("scores", "looks_scores"):  # a run continued from another with other panoramas has its own
            if state_dict.get(prefix + name, self.scores).shape != getattr(self, name).shape:
                state_dict[prefix + name] = getattr(self, name)
        super()._load_from_state_dict(state_dict, prefix, *arguments)


def network_parts(
    raw: Mapping[str, Any], spec: Mapping[str, Any], build: Callable[..., Any]
) -> tuple[CalibrationNet, CalibrationSpec, Parameterization]:
    """Build the arguments of a :class:`CameraNetwork`, with new weights.

    Args:
        raw: the config, as plain values.
        spec: the fields of a :class:`CalibrationSpec`.
        build: builds the part for a group of the config, with further arguments.

    Raises:
        UserError: a part cannot be built, or the inhibition does not fit the backbone.
    """
    task = raw["task"]
    listed: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in spec.items()}
    facts = CalibrationSpec(**listed)
    backbone = build(
        "backbone",
        in_channels=6 if task["coordinates"] else 3,
        image_size=(facts.height, facts.width),
        num_classes=task["features"],
    )
    try:
        backbone = build("inhibition")(backbone)
    except ValueError as error:
        raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None
    lines = None if task.get("canvas") is None else task["canvas"]["lines"]
    parameterization: Parameterization = build("parameterization")
    field = task.get("perspective_field") is not None
    if field and parameterization.name not in WITH_FIELD:
        raise UserError(
            f"task.perspective_field: parameterization={parameterization.name} cannot represent every camera that may "
            "be fitted to a field",
            f"parameterization={' or '.join(WITH_FIELD)}, or task.perspective_field=null",
        )
    try:
        network = CalibrationNet(backbone, task["features"], coordinates=task["coordinates"], lines=lines, field=field)
    except ArgumentError as error:
        raise UserError(
            f"task.perspective_{error.problem}", "backbone=efficientnet_lite0, or task.perspective_field=null"
        ) from None
    return network, facts, parameterization


def trained_camera_network(content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False) -> CameraNetwork:
    """Load the network of a calibration run, in evaluation mode.

    Args:
        content: content of its checkpoint, from :func:`~sextant.kit.trained.read_trained`.
        checkpoint: the checkpoint's file, for error messages.
        trust: build user-defined parts that the config names.

    Raises:
        UserError: the run is of another task, its config is wrong or names user-defined code, or the weights do not
            fit or are not finite.
    """
    trained = content[KEY]
    if trained["task"] != "calibration":
        raise UserError(
            f"{checkpoint} is a model of {trained['task']}, not of calibration", "Name a run of task=calibration."
        )
    plain = without_weights(own_config(trained, trust=trust)).plain
    with building():
        network = CameraNetwork(*network_parts(plain, trained["spec"], partial(build, plain)))
    # leave out what belongs to training alone: the state of a loss
    own = {name: value for name, value in content["state_dict"].items() if not name.startswith("loss.")}
    load_weights(network, {"state_dict": own}, checkpoint)
    return network.eval()
