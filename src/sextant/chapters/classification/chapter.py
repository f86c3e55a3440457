"""The chapter of image classification under corruptions: what its runs consist of."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sextant.chapters.classification.config import ClassificationConfig
from sextant.config.building import build, part_name
from sextant.config.schema.images import PerturbationSuite
from sextant.errors import UserError
from sextant.evaluation.headline import Headline
from sextant.kit.assemble import about_headline, build_dataset, build_suite, build_training, conditions_name
from sextant.kit.chapter import Chapter, TestRecord
from sextant.kit.trained import image_spec
from sextant.tables import counted

if TYPE_CHECKING:
    from numpy import ndarray
    from torch import nn

    from sextant.chapters.classification.task import Classification
    from sextant.data.datamodule import ImageData
    from sextant.data.source import ImageSource
    from sextant.kit.measure import RunValues, SharedSet


class ClassificationChapter(Chapter[ClassificationConfig]):
    """See :class:`~sextant.chapters.classification.task.Classification`."""

    about = "Push-pull inhibition against image corruptions (chapter 7)."
    evaluation_example = ("corruption=gaussian",)
    splits = ("train", "test")
    monitor = ("val/accuracy", "max")
    sweep_example = ("inhibition", ("none", "push_pull"))
    cannot_test = ()
    test_settings = ("test_every",)

    def source(self, config: ClassificationConfig) -> "ImageSource":
        """The dataset as a source of labelled images."""
        source = build_dataset(config)
        if not hasattr(source, "spec"):
            name = getattr(source, "name", config.dataset.target)
            raise UserError(
                f"dataset={name} holds no labelled images, which task=classification needs",
                "Choose digits, mnist, fashion_mnist, cifar10, cifar100 or image_folder; "
                "worlds are rendered by sextant data render.",
            )
        return source  # type: ignore[no-any-return]

    def training_size(self, config: ClassificationConfig, source: "ImageSource") -> int | None:
        """The size of the training split without its held-out share."""
        from sextant.data.source import ImageSource

        count = source.count("train") if isinstance(source, ImageSource) else None  # a custom source may have no count
        return None if count is None else count - round(config.task.validation_fraction * count)

    def summary(self, config: ClassificationConfig) -> dict[str, str]:
        """Network, inhibition and test conditions."""
        return {
            "backbone": part_name(config.plain["backbone"]),
            "inhibition": part_name(config.plain["inhibition"]),
            "augmentation": part_name(config.plain.get("augmentation") or {"_target_": "none"}),
            "test": conditions_name(config.plain["corruption"]),
        }

    def data(self, config: ClassificationConfig, source: "ImageSource") -> "ImageData":
        """The batches of a source."""
        from sextant.data.datamodule import ImageData

        return ImageData(
            source,
            batch_size=config.trainer.batch_size,
            eval_batch_size=config.trainer.eval_batch_size,
            validation_fraction=config.task.validation_fraction,
            split_seed=config.task.split_seed,
            seed=config.seed,
            augmentation=None if config.augmentation is None else build(config.plain, "augmentation"),
            workers=config.trainer.workers,
            test_every=config.task.test_every,
        )

    def spec(self, config: ClassificationConfig, source: "ImageSource", data: Any) -> dict[str, Any]:
        """The shape and the classes of the images."""
        spec = source.spec()
        return {"channels": spec.channels, "height": spec.height, "width": spec.width, "classes": list(spec.classes)}

    def module(self, config: ClassificationConfig, spec: Mapping[str, Any], *, training: bool) -> "Classification":
        """The classification module."""
        from sextant.chapters.classification.task import Classification

        return Classification(
            self.new_network(config, spec),
            image_spec(spec),
            build_suite(config),
            **build_training(config, training=training),
        )

    def require_fit(self, config: ClassificationConfig, spec: Mapping[str, Any], source: "ImageSource") -> None:
        """Raise a ``UserError`` unless the images have the shape and the number of classes of training."""
        trained, found = image_spec(spec), source.spec()
        if (found.channels, found.height, found.width) != (trained.channels, trained.height, trained.width):
            raise UserError(
                f"dataset={source.name} has images of {found.channels}x{found.height}x{found.width}, "
                f"the model was trained on {trained.channels}x{trained.height}x{trained.width}",
                "Choose a dataset of that shape; image_folder and digits take dataset.size",
            )
        if len(found.classes) != len(trained.classes):
            raise UserError(
                f"dataset={source.name} has {counted(len(found.classes), 'class', 'classes')}, the model was trained "
                f"on {len(trained.classes)}"
            )
        if found.classes != trained.classes:
            self.reporter.say(f"the classes of dataset={source.name} have names other than those in training")

    def record(self, module: "Classification", data: "ImageData", config: ClassificationConfig) -> TestRecord:
        """Predictions by condition, figures of the test, cost of the network, and the test protocol."""
        from sextant.chapters.classification.report import corruption_table, result_figures

        assert module.result is not None
        pictures = result_figures(
            module.result, module.suite, module.network, module.spec.classes, data.split("test").images
        )
        accuracy = {} if isinstance(config.corruption, PerturbationSuite) else module.result.accuracy()
        headline = Headline("accuracy", "%", "higher", {"clean": 1.0} | accuracy)
        told = about_headline(config, headline, (module.spec.height, module.spec.width))
        table = (
            [] if isinstance(config.corruption, PerturbationSuite) else corruption_table(module.result, module.suite)
        )
        return TestRecord(module.result.arrays(), pictures, headline.metrics(), table, module.facts() | told)

    def measured(
        self, arrays: Mapping[str, "ndarray"], shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """Accuracy, or errors under a published set."""
        from sextant.kit.measure import classified

        return classified(arrays, shared)

    def new_network(self, config: ClassificationConfig, spec: Mapping[str, Any]) -> "nn.Module":
        """The network with its inhibition; it maps images in [0, 1] to logits.

        Raises:
            UserError: a part cannot be built, or the inhibition does not fit the backbone.
        """
        images = image_spec(spec)
        network = build(
            config.plain,
            "backbone",
            in_channels=images.channels,
            image_size=(images.height, images.width),
            num_classes=len(images.classes),
        )
        try:
            return build(config.plain, "inhibition")(network)  # type: ignore[no-any-return]
        except ValueError as error:
            raise UserError(f"inhibition: {error}", "Choose another backbone, or inhibition=none") from None


CHAPTER = ClassificationChapter
