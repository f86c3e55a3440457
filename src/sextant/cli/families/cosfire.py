"""Recognition by COSFIRE filters: how its parts are put together."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.cli.assemble import build, build_dataset, build_training, part_name
from sextant.cli.descriptors import descriptor_identity
from sextant.cli.families.classification import image_spec
from sextant.cli.families.family import Family, Source, TestRecord
from sextant.cli.work_progress import work_progress
from sextant.config import Config
from sextant.config.schema import CosfireTask
from sextant.config.schema.cosfire import FeatureBank, VectorBank, VectorKeypoints
from sextant.config.schema.tasks import SceneChoice
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    from sextant.data.examples import ExampleData
    from sextant.layers.cosfire import Cosfire
    from sextant.models import FeatureMap
    from sextant.tasks.cosfire import CosfireRecognition


class CosfireFamily(Family):
    """See :class:`~sextant.tasks.cosfire.CosfireRecognition`."""

    evaluation_example = "dataset=mnist"
    sweep_example = "seed=0,1,2 bank=gabor,vectors"
    test_settings = ("test_every",)

    def source(self, raw: Mapping[str, Any], config: Config) -> ImageSource:
        """The dataset as a source of labelled images."""
        _check_parts(config)
        if raw["corruption"].get("corruptions"):
            raise UserError("corruption: task=cosfire tests images as they are", "corruption=none")
        source, scenes = build_dataset(raw, config), _task(config).scenes
        if config.descriptor is not None:
            descriptor_identity(raw["descriptor"], Path(config.paths.outputs))  # a missing run is told at once
        if hasattr(source, "spec"):
            if scenes is not None:
                raise UserError(
                    f"task.scenes: dataset={source.name} has classes, not places", "Leave task.scenes out (null)."
                )
            return source  # type: ignore[no-any-return]
        if scenes is None:
            raise UserError(
                f"dataset={getattr(source, 'name', raw['dataset'].get('_target_'))} holds no labelled images, which "
                "task=cosfire needs; of places it needs task.scenes",
                "Choose digits, mnist, fashion_mnist, cifar10 or image_folder, or experiment=cosfire_places.",
            )
        return _scenes(source, scenes)

    def check(self, source: Source) -> None:
        """Raise a ``UserError`` if files of the training or the test split are missing."""
        source.files("train")
        source.files("test")

    def summary(self, raw: Mapping[str, Any], config: Config) -> dict[str, str]:
        """Features, bank, strategy and methods."""
        task, features = _task(config), raw["features"]
        learnt = "none" if raw.get("backbone") is None else part_name(raw["backbone"])
        return {
            "features": learnt if features["run"] is None else f"run {features['run']}",
            "bank": part_name(raw["bank"]),
            "strategy": part_name(raw["strategy"]),
            "filters": f"{task.filters_per_class} a class",
            "methods": ", ".join(task.methods),
        }

    def data(self, raw: Mapping[str, Any], config: Config, source: ImageSource) -> "ExampleData":
        """The batches of a source, and its examples."""
        from sextant.data.examples import ExampleData, ExampleSettings

        task = _task(config)
        classes = len(source.spec().classes)
        if task.novel_classes and not 2 <= task.novel_classes <= classes - 2:
            raise UserError(
                f"task.novel_classes={task.novel_classes}: dataset={source.name} has {classes} classes, of which the "
                "network and the test need two each at least",
                f"Choose 0, or a number from 2 to {classes - 2}.",
            )
        return ExampleData(
            source,
            batch_size=config.trainer.batch_size,
            eval_batch_size=config.trainer.eval_batch_size,
            validation_fraction=task.validation_fraction,
            split_seed=task.split_seed,
            seed=config.seed,
            augmentation=None if raw.get("augmentation") is None else build(raw, "augmentation"),
            workers=config.trainer.workers,
            test_every=task.test_every,
            settings=ExampleSettings(task.images, task.novel_classes, task.examples, held_out=task.scenes is None),
        )

    def spec(self, raw: Mapping[str, Any], config: Config, source: ImageSource, data: Any) -> dict[str, Any]:
        """Shape and classes of the images; of features of another run, what builds its network."""
        spec = source.spec()
        told = {"channels": spec.channels, "height": spec.height, "width": spec.width, "classes": list(spec.classes)}
        if config.features is not None and config.features.run is not None:
            from sextant.cli.trained_model import read_trained
            from sextant.runs.checkpoint import KEY

            content = read_trained(resolve_run(config.features.run, Path(config.paths.outputs)).checkpoint)[KEY]
            told["features"] = {name: content[name] for name in ("task", "config", "spec")}
        return told

    def module(self, raw: Mapping[str, Any], spec: Mapping[str, Any], *, training: bool) -> "CosfireRecognition":
        """The module, with its network or the feature map of another run's."""
        from sextant.tasks.cosfire import Comparison, CosfireRecognition
        from sextant.tasks.filter_prototypes import PrototypeSettings
        from sextant.tasks.fine_tuning import FineTuning

        images, task = image_spec(spec), raw["task"]
        shape = (images.channels, images.height, images.width)
        network, features = None, None
        if "features" in spec:
            features = _features_of(raw, spec["features"], shape, training=training)
        elif raw.get("backbone") is not None:
            network = build(
                raw, "backbone", in_channels=shape[0], image_size=shape[1:], num_classes=len(images.classes)
            )
            if raw.get("inhibition") is not None:
                network = build(raw, "inhibition")(network)
        return CosfireRecognition(
            partial(make_filters, raw),
            images.classes,
            PrototypeSettings(task["filters_per_class"], task["at"], task["margin"], task["least_parts"]),
            Comparison(
                tuple(task["methods"]),
                tuple(task["prices"]),
                logarithms=task["logarithms"],
                network_answers=not task["novel_classes"],
                fine_tuning=FineTuning(**task["fine_tune"]),
            ),
            image_shape=shape,
            network=network,
            layer=raw["features"]["layer"],
            features=features,
            describe=_describing(raw),
            seed=raw["seed"],
            show=partial(work_progress, unit="images"),
            **(build_training(raw, training) if network is not None else {}),
        )

    def require_fit(self, raw: Mapping[str, Any], spec: Mapping[str, Any], source: ImageSource) -> None:
        """Raise a ``UserError`` unless the images have the shape and the classes of training."""
        trained, found = image_spec(spec), source.spec()
        if (found.channels, found.height, found.width, found.classes) != (
            trained.channels,
            trained.height,
            trained.width,
            trained.classes,
        ):
            raise UserError(
                f"dataset={source.name} has {len(found.classes)} classes of images of {found.channels}x{found.height}x"
                f"{found.width}, the filters were configured from {len(trained.classes)} of {trained.channels}x"
                f"{trained.height}x{trained.width}",
                "Choose a dataset of the same classes and shape; image_folder and digits take dataset.size",
            )

    def record(self, module: "CosfireRecognition", data: "ExampleData", config: Config) -> TestRecord:
        """Answers by method, pictures, a table of methods, and how many filters and parts there are."""
        from sextant.tasks.cosfire_report import method_table

        assert module.result is not None
        return TestRecord(
            module.arrays(), module.figures(data), table=method_table(module.result), facts=module.facts()
        )


def make_filters(raw: Mapping[str, Any], features: "FeatureMap | None") -> "Cosfire":
    """Filters by the groups ``bank``, ``strategy`` and ``filters``, not configured yet.

    Raises:
        UserError: the bank looks at a feature map and there is none.
    """
    from sextant.layers.cosfire import Blur, Cosfire, Tolerance

    chosen = raw["filters"]
    kinds = {part.model_fields["target"].annotation.__args__[0] for part in (FeatureBank, VectorBank)}  # type: ignore[union-attr]
    arguments: dict[str, Any] = {}
    if raw["bank"]["_target_"] in kinds:
        if features is None:
            raise UserError(
                f"bank={part_name(raw['bank'])} looks at a feature map, and there is no network",
                "Choose a backbone, or bank=gabor.",
            )
        arguments = {"features": features, "size": features.channels}
    try:
        return Cosfire(
            build(raw, "bank", **arguments),
            build(raw, "strategy"),
            blur=Blur(chosen["sigma0"], chosen["alpha"], chosen["blur"]),
            mean=chosen["mean"],
            least_weight=chosen["least_weight"],
            tolerance=Tolerance(chosen["rotations"], chosen["span_deg"], tuple(chosen["scales"]), chosen["reflection"]),
            t1=chosen["t1"],
            t3=chosen["t3"],
            floor=chosen["floor"],
        )
    except ValueError as error:
        raise UserError(f"filters: {error}") from None


def _features_of(
    raw: Mapping[str, Any], kept: Mapping[str, Any], shape: tuple[int, int, int], *, training: bool
) -> "FeatureMap":
    """The feature map of another run's network; its weights are read when training begins, and then kept with ours."""
    from sextant.cli.families import family_of
    from sextant.cli.trained_model import read_trained
    from sextant.models import FeatureMap

    if kept["task"] not in ("classification", "place_recognition"):
        raise UserError(
            f"features.run={raw['features']['run']} is a run of task={kept['task']}, which has no feature map",
            "Name a run of task=classification or task=place_recognition.",
        )
    module = family_of(kept["task"]).module(kept["config"], kept["spec"], training=False)
    if training:
        checkpoint = resolve_run(raw["features"]["run"], Path(raw["paths"]["outputs"])).checkpoint
        module.load_state_dict(read_trained(checkpoint)["state_dict"])
    layer = raw["features"]["layer"]
    if kept["task"] == "place_recognition":
        if layer is not None:  # one feature map within another would never see a layer of the inner one
            known = module.network.backbone
            network = known.network if isinstance(known, FeatureMap) else known
            module.network.backbone = FeatureMap(network, shape[0], shape[1:], layer=layer)
        layer = "backbone"
    return FeatureMap(module.network.eval(), shape[0], shape[1:], layer=layer)


def _scenes(dataset: Any, chosen: SceneChoice) -> ImageSource:
    """Places of a dataset as classes; rendered with progress if need be."""
    from sextant.data.places import PlaceTolerance, Scenes, as_place_source, rendered_place_source

    source = as_place_source(dataset)
    world = rendered_place_source(source)
    if world is not None:
        world.showing = partial(work_progress, f"rendering {world.name}, once", "images")
    return Scenes(
        source,
        references=chosen.references,
        queries=chosen.queries,
        spacing=chosen.spacing,
        neighbours=chosen.neighbours,
        tolerance=PlaceTolerance(source.place_unit, **getattr(chosen.tolerance, source.place_unit).model_dump()),
    )


def _describing(raw: Mapping[str, Any]) -> Callable[[Any], Any] | None:
    """What gives images the place descriptors that the config names; None if it names none."""
    if raw.get("descriptor") is None:
        return None
    from sextant.cli.descriptors import DescriptorFiles, describer

    found = describer(raw, Path(raw["paths"]["outputs"]))
    if isinstance(found, DescriptorFiles):
        raise UserError("descriptor=files knows drives, not images of scenes", "Choose descriptor=run:<id>.")
    return found.describe


def _check_parts(config: Config) -> None:
    """Raise a ``UserError`` where bank, strategy and network do not go together."""
    if isinstance(config.bank, VectorBank) != isinstance(config.strategy, VectorKeypoints):
        raise UserError(
            "bank=vectors and strategy=vector_keypoints belong together",
            "Choose both, or another bank with strategy=circles or channel_peaks.",
        )
    task = _task(config)
    trained_before = config.features is not None and config.features.run is not None
    if task.scenes is not None:
        _check_scenes(task, trains=config.backbone is not None and not trained_before)
    if isinstance(config.bank, (VectorBank, FeatureBank)) and config.backbone is None and not trained_before:
        raise UserError(
            "no backbone and no features.run: bank looks at the feature map of a network",
            "Choose a backbone, features=run:<id>, or bank=gabor.",
        )
    lacking = {
        "network": config.backbone is None or trained_before or bool(task.novel_classes),
        "descriptor": config.descriptor is None,
        **dict.fromkeys(("full_svm", "pooled_svm", "nearest"), config.backbone is None and not trained_before),
    }
    if all(lacking.get(method, False) for method in task.answering()):
        raise UserError(
            f"task.methods=[{', '.join(task.methods)}]: this run has none of what these need: a network (of its own "
            "and of the classes that are tested for method network), or a descriptor",
            "Add cosfire_svm or strongest_filter.",
        )


def _check_scenes(task: CosfireTask, *, trains: bool) -> None:
    """Raise a ``UserError`` where something is chosen that places as classes leave no room for."""
    if trains:
        raise UserError(
            "task.scenes: places have too few images each to train a network on",
            "Name one: features=run:<id>; or bank=gabor strategy=circles '~backbone'.",
        )
    if len(task.prices) > 1:
        raise UserError(
            f"task.prices={task.prices}: scenes leave no image to choose a price by", "For example task.prices=[1.0]"
        )
    for name, chosen in (("images", task.images), ("examples", task.examples), ("novel_classes", task.novel_classes)):
        if chosen:
            raise UserError(
                f"task.{name}={chosen}: scenes have the images that task.scenes.references and neighbours name, and "
                "are all told by these alone",
                "Leave it out; fewer scenes: task.scenes.spacing.",
            )


def _task(config: Config) -> CosfireTask:
    assert isinstance(config.task, CosfireTask)
    return config.task
