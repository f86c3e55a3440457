"""Reading a trained model from its file, whoever wrote it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.errors import UserError

if TYPE_CHECKING:
    from torch import nn

PUBLISHED = ".pth.tar"  # what the push-pull paper's authors call their files
RUNNING = ("running_mean", "running_var")  # statistics of normalisation, which are weights as well


def read_trained(path: Path) -> dict[str, Any]:
    """The content of a checkpoint of Sextant, or of a published push-pull network as if it were one.

    Raises:
        UserError: the file is missing, damaged or neither of the two; nothing in it was executed.
    """
    if path.name.endswith(PUBLISHED):
        return published_content(path)
    from sextant.runs.checkpoint import load_checkpoint

    return load_checkpoint(path)


def model_from_checkpoint(raw: Mapping[str, Any], config: Config, content: Mapping[str, Any], checkpoint: Path) -> Any:
    """The trained module of a checkpoint, built from ``raw``: its own config, perhaps with other test conditions.

    Args:
        raw, config: plain and typed.
        content: of the checkpoint, by :func:`read_trained`.
        checkpoint: its file, for messages.

    Raises:
        UserError: the weights do not fit, or are not finite.
    """
    from sextant.recipes import recipe_of
    from sextant.runs.checkpoint import KEY

    module = recipe_of(config.task.name).module(raw, content[KEY]["spec"], training=False)
    load_weights(module, content, checkpoint)
    return module.eval()


def classifier_from_checkpoint(raw: Mapping[str, Any], content: Mapping[str, Any], checkpoint: Path) -> "nn.Module":
    """The network of a checkpoint of classification, which gives logits; Lightning is not imported.

    Args and errors are those of :func:`model_from_checkpoint`.
    """
    from torch import nn

    from sextant.recipes.classification import ClassificationRecipe
    from sextant.runs.checkpoint import KEY

    whole = nn.ModuleDict({"network": ClassificationRecipe().network(raw, content[KEY]["spec"])})
    load_weights(whole, content, checkpoint)
    return whole["network"].eval()


def load_weights(module: "nn.Module", content: Mapping[str, Any], checkpoint: Path) -> None:
    """Load what a checkpoint holds into a module, in place.

    What a task has noted beside its weights, such as the score of what was never seen, may be infinite.

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


def published_content(path: Path) -> dict[str, Any]:
    """A published network in the form of a checkpoint: the config that builds it, the shape of its images, weights.

    What the config says of training is nobody's: ``published`` has what the file says.

    Raises:
        UserError: the file is not one of the authors', or its inhibition is not in the first convolution.
    """
    from sextant.cli.compose import compose, to_plain
    from sextant.data.cifar10 import CLASSES
    from sextant.layers import first_conv
    from sextant.models import load_published
    from sextant.runs.checkpoint import KEY, SCHEMA_VERSION

    found = load_published(path)
    first, _ = first_conv(found.network)
    if found.push_pull not in ((), (first,)):
        raise UserError(f"{path} has push-pull layers at {', '.join(found.push_pull)}", "Only the first can be one.")
    family, depth, *growth = found.architecture.split("-")
    backbone = {
        "resnet": ["backbone=resnet20", f"backbone.depth={depth}"],
        "densenet": ["backbone=densenet_40_12", f"backbone.depth={depth}", *(f"backbone.growth={g}" for g in growth)],
    }[family]
    inhibition = "push_pull" if found.push_pull else "none"
    choices = ["task=classification", "dataset=cifar10", "corruption=none", f"inhibition={inhibition}", *backbone]
    return {
        KEY: {
            "schema_version": SCHEMA_VERSION,
            "config": to_plain(compose(choices)),
            "spec": {"channels": 3, "height": 32, "width": 32, "classes": list(CLASSES)},
            "task": "classification",
            "published": {"file": path.name, "epoch": found.epoch, "best_accuracy": found.best_accuracy},
        },
        "state_dict": {f"network.{name}": tensor for name, tensor in found.network.state_dict().items()},
    }
