"""Reading a trained model from its file, whoever wrote it."""

from pathlib import Path
from typing import Any

from sextant.errors import UserError

PUBLISHED = ".pth.tar"  # what the push-pull paper's authors call their files


def read_trained(path: Path) -> dict[str, Any]:
    """The content of a checkpoint of Sextant, or of a published push-pull network as if it were one.

    Raises:
        UserError: the file is missing, damaged or neither of the two; nothing in it was executed.
    """
    if path.name.endswith(PUBLISHED):
        return published_content(path)
    from sextant.runs.checkpoint import load_checkpoint

    return load_checkpoint(path)


def published_content(path: Path) -> dict[str, Any]:
    """A published network in the form of a checkpoint: the config that builds it, the shape of its images, weights.

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
        },
        "state_dict": {f"network.{name}": tensor for name, tensor in found.network.state_dict().items()},
    }
