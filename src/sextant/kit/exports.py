"""Networks of trained models in a form for other programs: from tensors to tensors, with push-pull layers folded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.kit.content import own_config
from sextant.runs.checkpoint import KEY

if TYPE_CHECKING:
    from sextant.chapters.calibration.network import CameraNetwork

Content = Mapping[str, Any]


@dataclass(frozen=True)
class Exportable:
    """A network with its inputs and outputs; the first dimension of each is the batch.

    Attributes:
        network: takes the inputs by name, and returns a tensor, or a tuple with one tensor per output.
        inputs: an example of each input, with a batch of two.
        meanings: descriptions of the inputs and then the outputs, in order.
    """

    network: nn.Module
    inputs: Mapping[str, Tensor]
    meanings: Mapping[str, str]

    @property
    def outputs(self) -> list[str]:
        """The names of the outputs."""
        return [name for name in self.meanings if name not in self.inputs]


def exportable(content: Content, checkpoint: Path, *, trust: bool = False) -> Exportable:
    """The network of a loaded checkpoint, with push-pull layers folded into plain convolutions.

    Args:
        content: content of the checkpoint from :func:`~sextant.kit.content.read_trained`.
        checkpoint: its file, for messages.
        trust: allow parts from outside Sextant that it names.

    Raises:
        UserError: the model has no network of its own, or its network cannot be exported.
    """
    from sextant.layers import fold

    task = str(content[KEY]["task"])
    if task not in EXPORTS:
        raise UserError(
            f"a model of task={task} has no network of its own to export",
            "Its map is saved by task.save_map; the network of its descriptor is a run of task=place_recognition.",
        )
    found = EXPORTS[task](content, checkpoint, trust)
    network = fold(found.network).requires_grad_(False).cpu()
    return Exportable(network, found.inputs, found.meanings)


class CameraHead(nn.Module):
    """A camera network with two output tensors: the camera, and the half-widths of its 95 % intervals."""

    widths: Tensor

    def __init__(self, network: "CameraNetwork"):
        super().__init__()
        from sextant.evaluation.conformal import conformal_quantile

        self.network = network
        quantile = conformal_quantile(network.scores, 0.95, network.spec.per_panorama)
        self.register_buffer("widths", quantile)

    def forward(self, images: Tensor, aspect: Tensor) -> tuple[Tensor, Tensor]:
        """Tilt, roll, focal length and k1; the half-widths are those of tilt, roll, field of view and k1/f²."""
        camera, scale = self.network(images, aspect)
        return torch.stack([camera.tilt, camera.roll, camera.focal, camera.k1], -1), scale * self.widths


class _Named(nn.Module):
    """A network whose single input has the name used in exports."""

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        """The network's output."""
        found: Tensor = self.network(images)
        return found


def _images(spec: Mapping[str, Any], channels: int | None = None) -> Tensor:
    return torch.rand(2, channels or spec["channels"], spec["height"], spec["width"])


def _told(spec: Mapping[str, Any], channels: int) -> str:
    kind = {1: "grey", 3: "RGB"}.get(channels, f"{channels} channels")
    return f"(b, {channels}, {spec['height']}, {spec['width']}), {kind}, from 0 to 1"


def _camera(content: Content, checkpoint: Path, trust: bool) -> Exportable:
    from sextant.chapters.calibration.camera_network import trained_camera_network

    spec = content[KEY]["spec"]
    if spec.get("canvas"):
        raise UserError(
            "this network sees photos on a square canvas, by sums over what each photo covers: it cannot be exported",
            "Use it from Python: sextant.PhotoCalibrator.load(<run>).",
        )
    network = CameraHead(trained_camera_network(content, checkpoint, trust=trust))
    meanings = {
        "images": f"{_told(spec, 3)}, the whole photo squashed to this size",
        "aspect": "(b): width over height of the photo",
        "camera": "(b, 4): tilt and roll in radians, focal length in heights of the photo, k1",
        "half_width_95": "(b, 4): half the 95 % intervals of tilt, roll, vertical field of view (radians) and k1/f²",
    }
    return Exportable(network, {"images": _images(spec, 3), "aspect": torch.tensor([4 / 3, 1.0])}, meanings)


def _classifier(content: Content, checkpoint: Path, trust: bool) -> Exportable:
    from sextant.kit.networks import trained_network

    spec = content[KEY]["spec"]
    network = trained_network(own_config(content[KEY], trust=trust), content, checkpoint)
    meanings = {
        "images": _told(spec, spec["channels"]),
        "logits": f"(b, {len(spec['classes'])}), in this order: {', '.join(map(str, spec['classes']))}",
    }
    return Exportable(_Named(network), {"images": _images(spec)}, meanings)


def _descriptor(content: Content, checkpoint: Path, trust: bool) -> Exportable:
    from sextant.kit.networks import trained_network

    spec = content[KEY]["spec"]
    network = trained_network(own_config(content[KEY], trust=trust), content, checkpoint)
    meanings = {
        "images": f"{_told(spec, spec['channels'])}, the whole photo stretched to this size",
        "descriptor": f"(b, {network.dimension}): photos of one place have descriptors that are close",
    }
    return Exportable(_Named(network), {"images": _images(spec)}, meanings)


def _filters(content: Content, checkpoint: Path, trust: bool) -> Exportable:
    """The feature map that the filters use; the filters themselves are not a network."""
    from sextant.kit.trained_model import model_from_checkpoint

    spec = content[KEY]["spec"]
    estimator = model_from_checkpoint(own_config(content[KEY], trust=trust), content, checkpoint).estimator
    if estimator.features is None:
        raise UserError(
            f"the filters of {checkpoint} look at images and not at a network",
            "Filters are saved as they are (docs/cosfire.md); only networks are exported.",
        )
    shape = f"(b, {estimator.features.channels}, {', '.join(map(str, estimator.features.size))})"
    meanings = {
        "images": _told(spec, spec["channels"]),
        "features": f"{shape}: the feature map that the filters look at, after rectification",
    }
    return Exportable(_Named(nn.Sequential(estimator.features, nn.ReLU())), {"images": _images(spec)}, meanings)


#: by task whose model is a network: the function that makes it exportable
EXPORTS: Mapping[str, Callable[[Content, Path, bool], Exportable]] = {
    "calibration": _camera,
    "classification": _classifier,
    "place_recognition": _descriptor,
    "cosfire": _filters,
}
