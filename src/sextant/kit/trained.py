"""Trained models: the content of their files, and the modules and networks that are built from it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.trained import trained_config, without_weights
from sextant.errors import UserError
from sextant.registry import chapter_of
from sextant.runs.resolve import ONNX_SUFFIX
from sextant.zoo.files import has_card, read_model

if TYPE_CHECKING:
    from torch import nn

    from sextant.data.source import ImageSpec


PUBLISHED = ".pth.tar"  # suffix of the files of the push-pull paper's authors
RUNNING = ("running_mean", "running_var")  # statistics of normalisation, which are weights as well


def read_trained(path: Path) -> dict[str, Any]:
    """Read a checkpoint, or in its form a model of the zoo, an ONNX file, or a published network for places or CIFAR.

    Raises:
        UserError: the file is missing, damaged or none of these; nothing in it was executed.
    """
    from sextant.runs.checkpoint import KEY

    if has_card(path):
        model, weights = read_model(path)
        return {KEY: model, "state_dict": weights}
    from sextant.kit.published_places import onnx_content, places_content

    if path.suffix == ONNX_SUFFIX:
        return onnx_content(path)
    if not path.name.endswith(PUBLISHED):
        return places_content(path)
    from sextant.kit.published import published_content
    from sextant.torch_file import building

    with building():  # which compares the weights with the network
        return places_content(path, published_content)


def own_config(trained: Mapping[str, Any], *, trust: bool = False) -> Config:
    """The config that a checkpoint contains, without what belongs to the run alone.

    Args:
        trained: what the checkpoint holds under ``runs.checkpoint.KEY``.
        trust: allow parts that are not Sextant's.

    Raises:
        UserError: as for :func:`~sextant.config.trained.trained_config`.
    """
    own = {**trained["config"], "init_from": None, "sweep": None}
    own.pop("debug", None)
    config = trained_config(own, trained["task"], trust=trust)
    if (within := trained["spec"].get("features")) is not None:  # of another run's network, which is built as well
        trained_config(within["config"], within["task"], trust=trust)
    return config


def load_weights(module: "nn.Module", content: Mapping[str, Any], checkpoint: Path) -> None:
    """Load the weights of a checkpoint into a module, in place.

    Values that a task stores besides its weights, such as scores of events without observations, may be infinite.

    Raises:
        UserError: the weights do not fit, or are not finite.
    """
    from sextant.torch_file import require_finite

    state = content["state_dict"]
    weights = {name for name, _ in module.named_parameters()}
    weights |= {name for name, _ in module.named_buffers() if name.endswith(RUNNING)}
    require_finite(state, checkpoint, weights)
    try:
        module.load_state_dict(state)
    except RuntimeError as error:
        lines = [line.strip() for line in str(error).splitlines()[1:4]]
        raise UserError(
            f"the weights in {checkpoint} do not fit this network: {' '.join(lines)}",
            "Choose the backbone and inhibition that the checkpoint was trained with.",
        ) from None


def model_from_checkpoint(config: Config, content: Mapping[str, Any], checkpoint: Path) -> Any:
    """The trained module of a checkpoint, built from ``config``.

    Args:
        config: the checkpoint's typed config, possibly with other test conditions.
        content: content of the checkpoint from :func:`read_trained`.
        checkpoint: its file, for messages.

    Raises:
        UserError: the weights do not fit, or are not finite.
    """
    from sextant.runs.checkpoint import KEY
    from sextant.torch_file import building

    with building():
        module = chapter_of(config.task.name).module(without_weights(config), content[KEY]["spec"], training=False)
    load_weights(module, content, checkpoint)
    return module.eval()


def new_network(config: Config, spec: Mapping[str, Any]) -> "nn.Module":
    """Build the network of a task that offers one, with new weights.

    Raises:
        UserError: a part cannot be built.
    """
    network: nn.Module = chapter_of(config.task.name).new_network(without_weights(config), spec)
    return network


def trained_network(config: Config, content: Mapping[str, Any], checkpoint: Path) -> Any:
    """Build the network of a checkpoint of a task that offers one, with its weights, in evaluation mode.

    Args:
        config: the checkpoint's own config, from :func:`~sextant.kit.trained.own_config`.
        content: content of the checkpoint, from :func:`~sextant.kit.trained.read_trained`.
        checkpoint: the checkpoint's file, for error messages.

    Raises:
        UserError: a part cannot be built, or the weights do not fit or are not finite.
    """
    from torch import nn

    from sextant.runs.checkpoint import KEY
    from sextant.torch_file import building

    trained = content[KEY]
    with building():
        whole = nn.ModuleDict({"network": new_network(config, trained["spec"])})
    # leave out what belongs to training alone, such as the state of a loss
    own = {name: value for name, value in content["state_dict"].items() if name.startswith("network.")}
    load_weights(whole, {"state_dict": own}, checkpoint)
    return whole["network"].eval()


def image_spec(spec: Mapping[str, Any]) -> "ImageSpec":
    """Shape and classes of the images that a model was trained on, from the spec in its checkpoint."""
    from sextant.data.source import ImageSpec

    return ImageSpec(spec["channels"], spec["height"], spec["width"], tuple(spec["classes"]))
