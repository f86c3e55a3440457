"""Published networks as checkpoints: those of the push-pull paper's authors, and what all have in common."""

from pathlib import Path
from typing import Any

from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs


def published_content(path: Path, content: Any = None) -> dict[str, Any]:
    """A published network in the form of a checkpoint: the config that builds it, the shape of its images, its weights.

    The training settings in the config are not those of the authors; the file's statements about training are in
    ``published``.

    Args:
        path: the file.
        content: of the file, if it has been read.

    Raises:
        UserError: the file is not one of the authors', or its inhibition is not in the first convolution.
    """
    from sextant.data.cifar10 import CLASSES
    from sextant.layers import first_conv
    from sextant.models import load_published
    from sextant.runs.checkpoint import KEY, SCHEMA_VERSION

    found = load_published(path, content=content)
    first, _ = first_conv(found.network)
    if found.push_pull not in ((), (first,)):
        raise UserError(
            f"{path} has push-pull layers at {', '.join(found.push_pull)}", "Only the first convolution can be one."
        )
    family, depth, *growth = found.architecture.split("-")
    if family == "resnet":
        backbone = {"_target_": "sextant.models.ResNetCifar", "depth": int(depth)}
    else:
        backbone = {"_target_": "sextant.models.DenseNetCifar", "depth": int(depth), "growth": int(growth[0])}
    return {
        KEY: {
            "schema_version": SCHEMA_VERSION,
            "config": _config(backbone, push_pull=bool(found.push_pull)),
            "spec": {"channels": 3, "height": 32, "width": 32, "classes": list(CLASSES)},
            "task": "classification",
            "published": {"file": path.name, "epoch": found.epoch, "best_accuracy": found.best_accuracy},
        },
        "state_dict": {f"network.{name}": tensor for name, tensor in found.network.state_dict().items()},
    }


def published_config(*, epochs: int, eval_batch_size: int, log_every: int, **own: Any) -> dict[str, Any]:
    """The config that builds a published network.

    The training settings are the task's defaults, not those of the authors.

    Args:
        epochs, eval_batch_size, log_every: of the task's defaults for ``trainer``.
        own: further groups.
    """
    outputs = str(default_outputs())
    return {
        "seed": 0,
        "init_from": None,
        "reuse": "exact",
        "corruption": {"_target_": "sextant.corruptions.CorruptionSuite", "corruptions": {}, "seed": 0},
        "inhibition": {"_target_": "sextant.layers.NoInhibition"},
        "trainer": {
            "accelerator": "cpu",
            "devices": 1,
            "precision": "32-true",
            "deterministic": True,
            "threads": 1,
            "max_epochs": epochs,
            "batch_size": 32,
            "eval_batch_size": eval_batch_size,
            "log_every": log_every,
            "workers": 0,
            "progress": True,
        },
        "tracking": {
            "kind": "sqlite",
            "uri": None,
            "experiment": None,
            "system_metrics": True,
            "system_metrics_every_s": 10,
            "log_checkpoint": False,
            "parent_run": None,
        },
        "paths": {"data": f"{outputs}/data", "outputs": outputs, "cache": f"{outputs}/data"},
        **own,
    }


def _config(backbone: dict[str, Any], *, push_pull: bool) -> dict[str, Any]:
    """What ``task=classification dataset=cifar10 corruption=none`` composes, with this network."""
    inhibition: dict[str, Any] = {"_target_": "sextant.layers.NoInhibition"}
    if push_pull:
        inhibition = {
            "_target_": "sextant.layers.PushPullInhibition",
            "where": "first",
            "scale": 2.0,
            "alpha": 1.0,
            "train_alpha": False,
            "impl": "auto",
        }
    return published_config(
        epochs=30,
        eval_batch_size=1000,
        log_every=50,
        dataset={"_target_": "sextant.data.cifar10.CIFAR10", "train_batches": 5, "download": False},
        augmentation={"_target_": "sextant.data.augmentation.NoAugmentation"},
        backbone=backbone,
        inhibition=inhibition,
        optimizer={
            "_target_": "torch.optim.SGD",
            "_partial_": True,
            "lr": 0.02,
            "momentum": 0.9,
            "nesterov": True,
            "weight_decay": 0.0005,
        },
        schedule={"_target_": "sextant.training.schedules.StepDecay", "at": [0.333333, 0.666667], "factor": 0.1},
        task={
            "name": "classification",
            "validation_fraction": 0.1,
            "split_seed": 0,
            "test_every": 1,
            "test_checkpoint": "last",
        },
    )
