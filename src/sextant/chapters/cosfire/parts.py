"""Parts of recognition by COSFIRE filters: filters, features of another run, scenes, descriptors."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.chapters.cosfire.config import (
    CosfireConfig,
    CosfireTask,
    FeatureBank,
    SceneChoice,
    VectorBank,
    VectorKeypoints,
)
from sextant.chapters.places.config import NetworkDescriptor, WhitenedPCADescriptor
from sextant.config.building import build, part_name
from sextant.config.schema.images import StoredSuite
from sextant.config.trained import trained_config
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.reporter import Reporter
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    from sextant.layers.cosfire import Cosfire
    from sextant.models import FeatureMap


def check_parts(config: CosfireConfig, task: CosfireTask) -> None:
    """Raise a ``UserError`` if bank, strategy and network are incompatible."""
    if isinstance(config.bank, VectorBank) != isinstance(config.strategy, VectorKeypoints):
        raise UserError(
            "bank=vectors and strategy=vector_keypoints belong together",
            "Choose both, or another bank with strategy=circles or channel_peaks.",
        )
    trained_before = _trained_before(config)
    if config.features.frozen:
        if config.features.run is not None:
            raise UserError(
                "features.frozen=true: the network of features.run is always frozen", "Leave out features.frozen."
            )
        if config.backbone is None:
            raise UserError(
                "features.frozen=true: there is no backbone", "backbone=efficientnet_lite0 backbone.stages=5"
            )
    _check_descriptor(config)
    if task.scenes is not None:
        _check_scenes(config, task, trains=config.backbone is not None and not trained_before)
    if isinstance(config.bank, (VectorBank, FeatureBank)) and config.backbone is None and not trained_before:
        raise UserError(
            "no backbone and no features.run: the bank needs the feature map of a network",
            "Choose a backbone, features=run:<id>, or bank=gabor.",
        )
    if not answering_with_parts(config, task):
        raise UserError(
            f"task.methods=[{', '.join(task.methods)}]: this run lacks what these need: a network (for method "
            "network its own, trained on the tested classes), or a descriptor",
            "Add cosfire_svm or strongest_filter.",
        )


def _check_descriptor(config: CosfireConfig) -> None:
    """Raise a ``UserError`` for a descriptor that is fitted to a map, or that is the backbone trained by this run."""
    of = config.descriptor
    if isinstance(of, WhitenedPCADescriptor) or (isinstance(of, NetworkDescriptor) and of.dimensions is not None):
        fix = (
            "descriptor.dimensions=null"
            if isinstance(of, NetworkDescriptor)
            else "descriptor=hog, or descriptor=run:<id>"
        )
        raise UserError(f"descriptor.dimensions={of.dimensions} are fitted to a map, and task=cosfire has none", fix)
    if isinstance(of, NetworkDescriptor) and not config.features.frozen:
        raise UserError(
            "descriptor=network uses the backbone without training, but this run trains it",
            "features.frozen=true with a pretrained backbone; or descriptor=run:<id>",
        )


def answering_with_parts(config: CosfireConfig, task: CosfireTask) -> list[str]:
    """The methods of the task, except those for which this run lacks a network or a descriptor."""
    trained_before = _trained_before(config)
    featureless = config.backbone is None and not trained_before
    lacking = {
        "network": config.backbone is None or trained_before or bool(task.novel_classes),
        "descriptor": config.descriptor is None,
        **dict.fromkeys(("full_svm", "pooled_svm", "nearest"), featureless),
        "nearest_short": featureless or config.descriptor is None,
    }
    return [method for method in task.answering() if not lacking.get(method, False)]


def _trained_before(config: CosfireConfig) -> bool:
    """Whether the filters use a network not trained by this run: another run's, or the frozen backbone."""
    return config.features.run is not None or bool(config.features.frozen)


def _check_scenes(config: CosfireConfig, task: CosfireTask, *, trains: bool) -> None:
    """Raise a ``UserError`` if an option is incompatible with places as classes."""
    if trains:
        raise UserError(
            "task.scenes: places have too few images each to train a network",
            "Name one: features=run:<id>; or backbone=efficientnet_lite0 features.frozen=true; or bank=gabor "
            "strategy=circles '~backbone'.",
        )
    for name, values, example in (("prices", task.prices, "[1.0]"), ("scalings", task.scalings, "[all]")):
        if len(values) > 1:
            raise UserError(
                f"task.{name}={values}: scenes leave no images for choosing one", f"For example task.{name}={example}"
            )
    if isinstance(config.corruption, StoredSuite):
        raise UserError(
            "corruption: stored corrupted images are labelled with classes, not with places",
            "corruption=cifar10_c, corruption=imagenet_c, or corruption=none",
        )
    if task.test_every > 1:
        raise UserError(
            f"task.test_every={task.test_every}: with scenes this would leave out some conditions",
            "Set task.test_every=1; fewer scenes: task.scenes.spacing.",
        )
    for name, chosen in (("images", task.images), ("examples", task.examples), ("novel_classes", task.novel_classes)):
        if chosen:
            raise UserError(
                f"task.{name}={chosen}: the images of scenes are set by task.scenes.references "
                "and task.scenes.neighbours alone",
                "Leave it out; fewer scenes: task.scenes.spacing.",
            )


def make_filters(config: CosfireConfig, features: "FeatureMap | None") -> "Cosfire":
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
                f"bank={part_name(config.plain['bank'])} needs a feature map, and there is no network",
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
    config: CosfireConfig, kept: Mapping[str, Any], shape: tuple[int, int, int], *, training: bool
) -> "FeatureMap":
    """The feature map of another run's network; its weights are read when training begins and kept in this run."""
    from sextant.kit.trained import new_network, read_trained, trained_network
    from sextant.models import FeatureMap
    from sextant.registry import offering

    assert config.features.run is not None
    run, novel = config.features.run, config.plain["task"]["novel_classes"]
    if kept["task"] not in offering("new_network"):
        raise UserError(
            f"features.run={run} is a run of task={kept['task']}, which has no feature map",
            "Name a run of task=classification or task=place_recognition.",
        )
    if kept["task"] == "classification" and novel:
        raise UserError(
            f"task.novel_classes={novel}: the network of features.run={run} was trained on its own classes, so "
            "none is certain to be new to it",
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


def describing(config: CosfireConfig) -> Callable[[Any], Any] | None:
    """The function that computes the place descriptors named by the config; None if it names none."""
    if config.descriptor is None:
        return None
    from sextant.chapters.places.descriptors import DescriptorFiles, describer

    found = describer(config)
    if isinstance(found, DescriptorFiles):
        raise UserError("descriptor=files holds descriptors of drives, not of scenes", "Choose descriptor=run:<id>.")
    return found.describe
