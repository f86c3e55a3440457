"""A network in an ONNX file as a describer of images; it needs the package onnxruntime."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError, how_to_install
from sextant.models.standardize import Standardize
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
from sextant.ranges import Count, checked

#: height and width of images for a network that leaves them open, as the photos of common test sets
USUAL_SIZE = (480, 640)
#: images described at once, which bounds the memory
MOST = 8


class OnnxPlaceNet(nn.Module):
    """Image to descriptor by ONNX Runtime on the CPU; the file's bytes are the module's state, so they are kept.

    Args:
        in_channels: 3.
        image_size: not used: the file states it, or takes any.
        num_classes: length of a descriptor.
        length: of the file, in bytes.
        standardized: the network takes images standardised by ImageNet's statistics; otherwise images in [0, 1].

    Attributes:
        dimension: length of a descriptor.

    Raises:
        UserError: onnxruntime is not installed.
    """

    model: Tensor

    @checked
    def __init__(
        self, in_channels: int, image_size: tuple[int, int], num_classes: int, *, length: Count, standardized: bool
    ):
        super().__init__()
        self.dimension = num_classes
        statistics = (IMAGENET_MEAN, IMAGENET_STD) if standardized else ((0.0,) * 3, (1.0,) * 3)
        self.standardize = Standardize(3, *statistics)
        self.register_buffer("model", torch.zeros(length, dtype=torch.uint8))
        self._session: Any = None

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b k"]:
        """Descriptors of images in [0, 1], as the network gives them."""
        if self._session is None:
            self._session = opened(self.model.cpu().numpy().tobytes(), "the network")
        (given,) = self._session.get_inputs()
        batches = self.standardize(images).cpu().numpy()
        found = [
            self._session.run([output_of(self._session)], {given.name: some})[0] for some in _split(batches, given)
        ]
        return torch.from_numpy(np.concatenate(found)).to(images.device)


def opened(model: bytes, named: str) -> Any:
    """A session of ONNX Runtime for the bytes of a file.

    Args:
        model: content of the file.
        named: the file, for messages.

    Raises:
        UserError: onnxruntime is not installed, or the bytes are no network that it can run.
    """
    try:
        import onnxruntime
    except ImportError:
        raise UserError("ONNX files need the package onnxruntime", how_to_install("export")) from None
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of many kinds of its own
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise UserError(
            f"{named} cannot be opened by ONNX Runtime: {reason}",
            "Export the network again, into one file without external data.",
        ) from None


def output_of(session: Any) -> str:
    """The name of the output that holds descriptors: the first with two axes."""
    return next((str(each.name) for each in session.get_outputs() if len(each.shape) == 2), "")


def read_onnx(model: bytes, named: str) -> tuple[tuple[int, int], int, bool]:
    """Height and width of the images of a network, the length of its descriptors, and whether images are standardised.

    Networks that Sextant exported (input ``images``, output ``descriptor``) take images in [0, 1]; for all others
    ImageNet's statistics are supposed.

    Raises:
        UserError: the network cannot be opened, does not take one batch of colour images of 32-bit floats (b, 3, h, w),
            or gives no descriptors (b, d).
    """
    session = opened(model, named)
    inputs = session.get_inputs()
    takes = ", ".join(f"{each.name} {each.shape} {each.type}" for each in inputs)
    shape = inputs[0].shape if inputs else []
    colours = len(shape) == 4 and (shape[1] == 3 or not isinstance(shape[1], int))  # open axes are names or None
    one = colours and (shape[0] == 1 or not isinstance(shape[0], int))
    if len(inputs) != 1 or inputs[0].type != "tensor(float)" or not one:
        raise UserError(
            f"{named} takes {takes or 'nothing'}; one input is needed, images (b, 3, h, w) of 32-bit floats, with "
            "b open or 1",
            "Export the network with such an input.",
        )
    output = output_of(session)
    if not output:
        raise UserError(
            f"{named} gives {', '.join(f'{each.name} {each.shape}' for each in session.get_outputs())}; descriptors "
            "(b, d) are needed",
            "Export the network up to its descriptor.",
        )
    height, width = (
        side if isinstance(side, int) else usual for side, usual in zip(shape[2:], USUAL_SIZE, strict=True)
    )
    image = np.zeros((1, 3, height, width), np.float32)
    try:
        found = session.run([output], {inputs[0].name: image})[0]
    except Exception as error:
        raise UserError(
            f"{named} cannot describe an image of {height}x{width}: {str(error).strip().splitlines()[0]}",
            "Export the network for images of one size.",
        ) from None
    return (height, width), int(found.shape[1]), (inputs[0].name, output) != ("images", "descriptor")


def _split(batch: Any, given: Any) -> Iterator[Any]:
    """The images one by one if the network takes one, otherwise a few at once."""
    step = 1 if isinstance(given.shape[0], int) else MOST
    return (batch[start : start + step] for start in range(0, len(batch), step))
