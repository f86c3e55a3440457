"""Checks that the choices for recognition by COSFIRE filters are compatible."""

from sextant.config import Config
from sextant.config.schema import CosfireTask
from sextant.config.schema.classification import StoredSuite
from sextant.config.schema.cosfire import FeatureBank, VectorBank, VectorKeypoints
from sextant.config.schema.localization import NetworkDescriptor, WhitenedPCADescriptor
from sextant.errors import UserError


def check_parts(config: Config, task: CosfireTask) -> None:
    """Raise a ``UserError`` if bank, strategy and network are incompatible."""
    if isinstance(config.bank, VectorBank) != isinstance(config.strategy, VectorKeypoints):
        raise UserError(
            "bank=vectors and strategy=vector_keypoints belong together",
            "Choose both, or another bank with strategy=circles or channel_peaks.",
        )
    trained_before = _trained_before(config)
    if config.features is not None and config.features.frozen:
        if config.features.run is not None:
            raise UserError(
                "features.frozen=true: the network of features.run stays as it is anyway", "Leave out features.frozen."
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
            "no backbone and no features.run: bank looks at the feature map of a network",
            "Choose a backbone, features=run:<id>, or bank=gabor.",
        )
    if not answering_with_parts(config, task):
        raise UserError(
            f"task.methods=[{', '.join(task.methods)}]: this run has none of what these need: a network (of its own "
            "and of the classes that are tested for method network), or a descriptor",
            "Add cosfire_svm or strongest_filter.",
        )


def _check_descriptor(config: Config) -> None:
    """Raise a ``UserError`` for a descriptor that learns from a map, or that is a backbone which is trained here."""
    of = config.descriptor
    if isinstance(of, WhitenedPCADescriptor) or (isinstance(of, NetworkDescriptor) and of.dimensions is not None):
        fix = (
            "descriptor.dimensions=null"
            if isinstance(of, NetworkDescriptor)
            else "descriptor=hog, or descriptor=run:<id>"
        )
        raise UserError(f"descriptor.dimensions={of.dimensions} are learnt from a map, and task=cosfire has none", fix)
    if isinstance(of, NetworkDescriptor) and (config.features is None or not config.features.frozen):
        raise UserError(
            "descriptor=network is the backbone as it is, not as it is trained here",
            "features.frozen=true with a backbone that brings weights; or descriptor=run:<id>",
        )


def answering_with_parts(config: Config, task: CosfireTask) -> list[str]:
    """The methods that answer, except those for which this run lacks a network or a descriptor."""
    trained_before = _trained_before(config)
    featureless = config.backbone is None and not trained_before
    lacking = {
        "network": config.backbone is None or trained_before or bool(task.novel_classes),
        "descriptor": config.descriptor is None,
        **dict.fromkeys(("full_svm", "pooled_svm", "nearest"), featureless),
        "nearest_short": featureless or config.descriptor is None,
    }
    return [method for method in task.answering() if not lacking.get(method, False)]


def _trained_before(config: Config) -> bool:
    """Whether the filters use a network that is not trained here: of another run, or the backbone as it is."""
    return config.features is not None and (config.features.run is not None or bool(config.features.frozen))


def _check_scenes(config: Config, task: CosfireTask, *, trains: bool) -> None:
    """Raise a ``UserError`` if an option is incompatible with places as classes."""
    if trains:
        raise UserError(
            "task.scenes: places have too few images each to train a network on",
            "Name one: features=run:<id>; or backbone=efficientnet_lite0 features.frozen=true; or bank=gabor "
            "strategy=circles '~backbone'.",
        )
    for name, values, example in (("prices", task.prices, "[1.0]"), ("scalings", task.scalings, "[all]")):
        if len(values) > 1:
            raise UserError(
                f"task.{name}={values}: scenes leave no image to choose one by", f"For example task.{name}={example}"
            )
    if isinstance(config.corruption, StoredSuite):
        raise UserError(
            "corruption: files of corrupted images have classes, and scenes are places",
            "corruption=cifar10_c, corruption=imagenet_c, or corruption=none",
        )
    if task.test_every > 1:
        raise UserError(
            f"task.test_every={task.test_every}: of scenes it would test some conditions alone",
            "Set task.test_every=1; fewer scenes: task.scenes.spacing.",
        )
    for name, chosen in (("images", task.images), ("examples", task.examples), ("novel_classes", task.novel_classes)):
        if chosen:
            raise UserError(
                f"task.{name}={chosen}: scenes have the images that task.scenes.references and neighbours name, and "
                "are all told by these alone",
                "Leave it out; fewer scenes: task.scenes.spacing.",
            )
