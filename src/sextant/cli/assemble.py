"""From a config to objects: the only place that builds what ``_target_`` names."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.errors import HydraException
from hydra.utils import instantiate

from sextant.config import Config
from sextant.data.source import ImageSource, ImageSpec
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.corruptions import CorruptionSuite
    from sextant.data.datamodule import ImageData
    from sextant.tasks.classification import Classification, OptimizerFactory


def build(raw: Mapping[str, Any], group: str, **arguments: Any) -> Any:
    """Build the object that the config of ``group`` describes, with further ``arguments``.

    Raises:
        UserError: the import path does not exist, or the object does not take these arguments.
    """
    node = raw[group]
    try:
        return instantiate(node, _convert_="all", **arguments)
    except UserError:
        raise
    except (HydraException, TypeError, ValueError, ImportError) as error:
        cause = error.__cause__ if isinstance(error, HydraException) and error.__cause__ is not None else error
        if isinstance(cause, UserError):
            raise cause from None
        reason = str(cause).splitlines()[0]
        raise UserError(
            f"{group}: {node.get('_target_')} cannot be built: {reason}",
            f"It is called with the keys of {group}" + (f" and {', '.join(arguments)}" if arguments else ""),
        ) from None


def build_dataset(raw: Mapping[str, Any], config: Config) -> Any:
    """The dataset, which looks in the data folder first and in the cache second."""
    return build(raw, "dataset", roots=list(dict.fromkeys([Path(config.paths.data), Path(config.paths.cache)])))


def build_source(raw: Mapping[str, Any], config: Config) -> ImageSource:
    """The dataset as a source of labelled images.

    Raises:
        UserError: it has no labels, or cannot be built.
    """
    source = build_dataset(raw, config)
    if not hasattr(source, "spec"):
        name = getattr(source, "name", raw["dataset"].get("_target_"))
        raise UserError(
            f"dataset={name} holds no labelled images, which task=classification needs",
            "Choose digits, mnist, fashion_mnist, cifar10 or image_folder; worlds are rendered by sextant data render.",
        )
    return source  # type: ignore[no-any-return]


def build_classification(
    raw: Mapping[str, Any], spec: ImageSpec, *, log_every: int, training: bool
) -> "Classification":
    """The classification module; ``training=False`` leaves out optimiser and schedule."""
    from sextant.tasks.classification import Classification

    network = build(
        raw,
        "backbone",
        in_channels=spec.channels,
        image_size=(spec.height, spec.width),
        num_classes=len(spec.classes),
    )
    suite: CorruptionSuite = build(raw, "corruption")
    try:
        network = build(raw, "inhibition")(network)
    except ValueError as error:
        raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None
    optimizer = build(raw, "optimizer")
    if training:
        _try_optimizer(raw, optimizer)
    return Classification(
        network,
        spec,
        suite,
        optimizer=optimizer if training else None,
        schedule=build(raw, "schedule") if training else None,
        log_every=log_every,
    )


def _try_optimizer(raw: Mapping[str, Any], optimizer: "OptimizerFactory") -> None:
    from torch import nn

    try:
        optimizer([nn.Parameter()])
    except (TypeError, ValueError) as error:
        raise UserError(f"optimizer: {raw['optimizer']['_target_']} does not take these keys: {error}") from None


def build_data(source: ImageSource, config: Config) -> "ImageData":
    """The batches of a source."""
    from sextant.data.datamodule import ImageData

    return ImageData(
        source,
        batch_size=config.trainer.batch_size,
        eval_batch_size=config.trainer.eval_batch_size,
        validation_fraction=config.task.validation_fraction,
        split_seed=config.task.split_seed,
        seed=config.seed,
        workers=config.trainer.workers,
    )
