"""The chapter of recognition by COSFIRE filters: what its runs consist of."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.chapters.cosfire.config import CosfireConfig
from sextant.chapters.cosfire.parts import (
    answering_with_parts,
    check_parts,
    describing,
    features_of_run,
    make_filters,
    scenes_of,
)
from sextant.chapters.places.descriptors import descriptor_identity
from sextant.config.building import build, part_name
from sextant.config.schema.images import PerturbationSuite
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.evaluation.headline import Headline
from sextant.kit.assemble import about_headline, build_dataset, build_suite, build_training, conditions_name
from sextant.kit.chapter import Chapter, TestRecord
from sextant.kit.trained import image_spec
from sextant.runs.resolve import resolve_run
from sextant.tables import counted

if TYPE_CHECKING:
    from numpy import ndarray

    from sextant.chapters.cosfire.task import CosfireRecognition
    from sextant.data.examples import ExampleData
    from sextant.kit.measure import RunValues, SharedSet


class CosfireChapter(Chapter[CosfireConfig]):
    """See :class:`~sextant.chapters.cosfire.task.CosfireRecognition`."""

    about = "Filters configured from one example (chapter 6)."
    evaluation_example = ("task.test_every=2",)
    splits = ("train", "test")
    monitor = ("val/accuracy", "max")
    sweep_example = ("task.filters_per_class", ("20", "5"))
    cannot_test = (PerturbationSuite,)
    alone = "configures filters from a few images, which one process does"
    test_settings = ("test_every",)

    def check_parts(self, config: CosfireConfig) -> None:
        """Raise a ``UserError`` if bank, strategy and network are incompatible, or the test conditions are."""
        check_parts(config, config.task)
        super().check_parts(config)

    def identity(self, config: CosfireConfig) -> dict[str, Any]:
        """The base identity, with those of the descriptor and of the run that provides the features."""
        found, outputs = super().identity(config), Path(config.paths.outputs)
        if config.descriptor is not None:
            found["descriptor"] = descriptor_identity(found["descriptor"], outputs)
        if config.features.run is not None:
            found["features"]["run"] = resolve_run(config.features.run, outputs, "features.run").identity
        return found

    def answers(self, config: CosfireConfig) -> list[str]:
        """The methods for which the run has the required network or descriptor."""
        return answering_with_parts(config, config.task)

    def source(self, config: CosfireConfig) -> ImageSource:
        """The dataset as a source of labelled images."""
        self.check_parts(config)
        source, scenes = build_dataset(config), config.task.scenes
        if config.descriptor is not None:
            descriptor_identity(config.plain["descriptor"], Path(config.paths.outputs))  # reports a missing run at once
        if hasattr(source, "spec"):
            if scenes is not None:
                raise UserError(
                    f"task.scenes: dataset={source.name} has classes, not places", "Leave task.scenes out (null)."
                )
            return source  # type: ignore[no-any-return]
        if scenes is None:
            raise UserError(
                f"dataset={getattr(source, 'name', config.dataset.target)} holds no labelled images, which "
                "task=cosfire needs; of places it needs task.scenes",
                "Choose digits, mnist, fashion_mnist, cifar10 or image_folder, or experiment=cosfire_places.",
            )
        return scenes_of(source, scenes, self.reporter)

    def summary(self, config: CosfireConfig) -> dict[str, str]:
        """Features, bank, strategy and methods."""
        task, features = config.task, config.plain["features"]
        learnt = "none" if config.backbone is None else part_name(config.plain["backbone"])
        learnt += ", as it is" if features.get("frozen") else ""
        return {
            "features": learnt if features["run"] is None else f"run {features['run']}",
            "bank": part_name(config.plain["bank"]),
            "strategy": part_name(config.plain["strategy"]),
            "filters": f"{task.filters_per_class} per class",
            "methods": ", ".join(task.methods),
            "test": conditions_name(config.plain["corruption"]),
        }

    def data(self, config: CosfireConfig, source: ImageSource) -> "ExampleData":
        """The batches of a source, and its examples."""
        from sextant.data.examples import ExampleData, ExampleSettings

        task = config.task
        classes = len(source.spec().classes)
        if task.novel_classes and not 2 <= task.novel_classes <= classes - 2:
            raise UserError(
                f"task.novel_classes={task.novel_classes}: dataset={source.name} has "
                f"{counted(classes, 'class', 'classes')}, and the network and the test each need at least two",
                f"Choose 0, or a number from 2 to {classes - 2}.",
            )
        return ExampleData(
            source,
            batch_size=config.trainer.batch_size,
            eval_batch_size=config.trainer.eval_batch_size,
            validation_fraction=task.validation_fraction,
            split_seed=task.split_seed,
            seed=config.seed,
            augmentation=None if config.augmentation is None else build(config.plain, "augmentation"),
            workers=config.trainer.workers,
            test_every=task.test_every,
            settings=ExampleSettings(task.images, task.novel_classes, task.examples, held_out=task.scenes is None),
        )

    def spec(self, config: CosfireConfig, source: ImageSource, data: Any) -> dict[str, Any]:
        """The shape and classes of the images; for features of another run, also what builds its network."""
        spec = source.spec()
        told = {"channels": spec.channels, "height": spec.height, "width": spec.width, "classes": list(spec.classes)}
        if config.features.run is not None:
            from sextant.kit.trained import own_config, read_trained
            from sextant.runs.checkpoint import KEY

            outputs = Path(config.paths.outputs)
            found = resolve_run(config.features.run, outputs, "features.run")
            content = read_trained(found.checkpoint)[KEY]
            own_config(content, trust=found.is_own(outputs))
            told["features"] = {name: content[name] for name in ("task", "config", "spec")}
        elif config.features.frozen:
            from sextant.chapters.places.backbone_layer import brings_weights

            told["brings_weights"] = brings_weights(config.plain["backbone"])
        return told

    def module(self, config: CosfireConfig, spec: Mapping[str, Any], *, training: bool) -> "CosfireRecognition":
        """The module, with its own network or the feature map of another run."""
        from sextant.chapters.cosfire.comparison import Comparison
        from sextant.chapters.cosfire.estimator import CosfireEstimator
        from sextant.chapters.cosfire.filter_prototypes import PrototypeSettings
        from sextant.chapters.cosfire.fine_tuning import FineTuning
        from sextant.chapters.cosfire.task import CosfireRecognition
        from sextant.chapters.places.backbone_layer import untrained_map

        images, task = image_spec(spec), config.plain["task"]
        shape = (images.channels, images.height, images.width)
        network, features = None, None
        layer = config.plain["features"]["layer"]
        if "features" in spec:
            features = features_of_run(config, spec["features"], shape, training=training)
        elif "brings_weights" in spec:
            features = untrained_map(config.plain, shape[0], shape[1:], layer, trained=spec["brings_weights"])
        elif config.backbone is not None:
            network = build(
                config.plain, "backbone", in_channels=shape[0], image_size=shape[1:], num_classes=len(images.classes)
            )
            if config.inhibition is not None:
                network = build(config.plain, "inhibition")(network)
        estimator = CosfireEstimator(
            partial(make_filters, config),
            images.classes,
            PrototypeSettings(task["filters_per_class"], task["at"], task["margin"], task["least_parts"]),
            Comparison(
                tuple(task["methods"]),
                tuple(task["prices"]),
                tuple(task["scalings"]),
                choose_among=task["choose_among"],
                logarithms=task["logarithms"],
                tiles=task["tiles"],
                network_answers=not task["novel_classes"],
                fine_tuning=FineTuning(**task["fine_tune"]),
            ),
            image_shape=shape,
            network=network,
            layer=layer,
            features=features,
            describe=describing(config),
            seed=config.seed,
            show=partial(self.reporter.progress, unit="images"),
        )
        return CosfireRecognition(
            estimator,
            build_suite(config),
            **(build_training(config, training=training) if network is not None else {}),
        )

    def require_fit(self, config: CosfireConfig, spec: Mapping[str, Any], source: ImageSource) -> None:
        """Raise a ``UserError`` unless the images have the shape and the classes of training."""
        trained, found = image_spec(spec), source.spec()
        if (found.channels, found.height, found.width, found.classes) != (
            trained.channels,
            trained.height,
            trained.width,
            trained.classes,
        ):
            raise UserError(
                f"dataset={source.name} has {counted(len(found.classes), 'class', 'classes')} of images of "
                f"{found.channels}x{found.height}x{found.width}, the filters were configured from "
                f"{len(trained.classes)} of {trained.channels}x{trained.height}x{trained.width}",
                "Choose a dataset of the same classes and shape; image_folder and digits take dataset.size",
            )

    def record(self, module: "CosfireRecognition", data: "ExampleData", config: CosfireConfig) -> TestRecord:
        """Answers by method, figures, a table of methods, and the numbers of filters and parts."""
        from sextant.chapters.cosfire.report import method_table, recognition_figures

        assert module.result is not None
        estimator, result = module.estimator, module.result
        figures = recognition_figures(estimator, result, data)
        headline = Headline("accuracy", "%", "higher", result.headline(estimator.methods[0]))
        height, width = data.split("test").images.shape[-2:]
        return TestRecord(
            result.arrays(),
            figures,
            headline.metrics(),
            method_table(result),
            estimator.facts() | about_headline(config, headline, (height, width)),
        )

    def measured(
        self, arrays: Mapping[str, "ndarray"], shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """Accuracy by method, or by condition for the method that is read."""
        from sextant.chapters.cosfire.measure import recognised

        return recognised(arrays, reads)


CHAPTER = CosfireChapter
