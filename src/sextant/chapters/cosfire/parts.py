"""Parts of recognition by COSFIRE filters: filters, features of another run, scenes, descriptors."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.config import Config
from sextant.config.building import build, part_name
from sextant.config.schema.cosfire import FeatureBank, VectorBank
from sextant.config.schema.tasks import SceneChoice
from sextant.config.trained import trained_config
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.reporter import Reporter
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    from sextant.layers.cosfire import Cosfire
    from sextant.models import FeatureMap


def make_filters(config: Config, features: "FeatureMap | None") -> "Cosfire":
    """Build filters from the groups ``bank``, ``strategy`` and ``filters``, not yet configured.

    Raises:
        UserError: the bank needs a feature map and there is none.
    """
    from sextant.layers.cosfire import Blur, Cosfire, Tolerance

    chosen = config.plain["filters"]
    kinds = {part.model_fields["target"].annotation.__args__[0] for part in (FeatureBank, VectorBank)}  # type: ignore[union-attr]
    arguments: dict[str, Any] = {}
    if config.plain["bank"]["_target_"] in kinds:
        if features is None:
            raise UserError(
                f"bank={part_name(config.plain['bank'])} looks at a feature map, and there is no network",
                "Choose a backbone, or bank=gabor.",
            )
        arguments = {"features": features, "size": features.channels}
    try:
        return Cosfire(
            build(config.plain, "bank", **arguments),
            build(config.plain, "strategy"),
            blur=Blur(chosen["sigma0"], chosen["alpha"], chosen["blur"]),
            mean=chosen["mean"],
            least_weight=chosen["least_weight"],
            tolerance=Tolerance(chosen["rotations"], chosen["span_deg"], tuple(chosen["scales"]), chosen["reflection"]),
            shift=chosen["shift"],
            border=chosen["border"],
            t1=chosen["t1"],
            t3=chosen["t3"],
            floor=chosen["floor"],
        )
    except ValueError as error:
        raise UserError(f"filters: {error}") from None


def features_of_run(
    config: Config, kept: Mapping[str, Any], shape: tuple[int, int, int], *, training: bool
) -> "FeatureMap":
    """The feature map of another run's network; its weights are read when training begins and kept in this run."""
    from sextant.kit.registry import offering
    from sextant.kit.trained import new_network, read_trained, trained_network
    from sextant.models import FeatureMap

    assert config.features is not None
    assert config.features.run is not None
    run, novel = config.features.run, config.plain["task"]["novel_classes"]
    if kept["task"] not in offering("new_network"):
        raise UserError(
            f"features.run={run} is a run of task={kept['task']}, which has no feature map",
            "Name a run of task=classification or task=place_recognition.",
        )
    if kept["task"] == "classification" and novel:
        raise UserError(
            f"task.novel_classes={novel}: the network of features.run={run} was trained on classes of its own, and "
            "none is known to be new to it",
            "Train the network here (a backbone in place of features=run), or task.novel_classes=0.",
        )
    own = trained_config(kept["config"], kept["task"], trust=True)  # parts from outside Sextant were refused before
    if training:
        checkpoint = resolve_run(run, Path(config.paths.outputs), "features.run").checkpoint
        network: Any = trained_network(own, read_trained(checkpoint), checkpoint)
    else:
        network = new_network(own, kept["spec"])
    layer = config.features.layer
    if kept["task"] == "place_recognition":
        if layer is not None:  # a feature map around another one cannot reach the inner layers
            known = network.backbone
            inner = known.network if isinstance(known, FeatureMap) else known
            network.backbone = FeatureMap(inner, shape[0], shape[1:], layer=layer)
        layer = "backbone"
    return FeatureMap(network.eval(), shape[0], shape[1:], layer=layer)


def scenes_of(dataset: Any, chosen: SceneChoice, reporter: Reporter) -> ImageSource:
    """Places of a dataset as classes, rendered with progress if necessary."""
    from sextant.chapters.places.data import PlaceTolerance, Scenes, as_place_source, rendered_place_source

    source = as_place_source(dataset)
    world = rendered_place_source(source)
    if world is not None:
        world.showing = partial(reporter.progress, f"rendering {world.name}, once", "images")
    return Scenes(
        source,
        references=chosen.references,
        queries=chosen.queries,
        spacing=chosen.spacing,
        neighbours=chosen.neighbours,
        tolerance=PlaceTolerance(source.place_unit, **getattr(chosen.tolerance, source.place_unit).model_dump()),
    )


def describing(config: Config) -> Callable[[Any], Any] | None:
    """The function that computes the place descriptors named by the config; None if it names none."""
    if config.descriptor is None:
        return None
    from sextant.chapters.places.descriptors import DescriptorFiles, describer

    found = describer(config)
    if isinstance(found, DescriptorFiles):
        raise UserError("descriptor=files knows drives, not images of scenes", "Choose descriptor=run:<id>.")
    return found.describe
