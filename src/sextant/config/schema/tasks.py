"""The tasks."""

from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, Field, model_validator

from sextant.config.schema.calibration import CameraLoss, Canvas, FieldPrediction
from sextant.config.schema.parts import Count, Node, Part, Positive, Seed, Share, distinct
from sextant.config.schema.places import OffTheShelf, PlaceAugmentation, PlaceLoss, ToleranceByUnit, Whitening
from sextant.config.schema.splits import BySplit, ImageSide

RecognitionMethod = Literal[
    "cosfire_svm",
    "tiled_svm",
    "strongest_filter",
    "full_svm",
    "pooled_svm",
    "nearest",
    "nearest_short",
    "network",
    "descriptor",
]


def once(values: list[str]) -> list[str]:
    """Return ``values`` if they are all different.

    Raises:
        ValueError: two values are equal.
    """
    if len(set(values)) < len(values):
        raise ValueError(f"values must differ, got {values}")
    return values


class TaskNode(Node):
    """Settings common to all tasks.

    Attributes:
        needs: groups of a config that the task requires.
        takes: further groups that it accepts; groups of other tasks are refused.
        loss_kind: kind of the group ``loss``, for a task that needs it.
    """

    needs: ClassVar[tuple[str, ...]] = ()
    takes: ClassVar[tuple[str, ...]] = ()
    loss_kind: ClassVar[type[Part]] = Part


class ClassificationTask(TaskNode):
    """Image classification."""

    needs = ("backbone", "inhibition")
    takes = ("augmentation",)

    name: Literal["classification"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    test_every: Count = Field(examples=[1])
    test_checkpoint: Literal["last", "best"]


class CalibrationTask(TaskNode):
    """Calibration from one image."""

    needs = ("backbone", "inhibition", "loss", "parameterization", "sampling")
    takes = ("test_sampling",)
    loss_kind = CameraLoss

    name: Literal["calibration"]
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[72])
    crops_per_panorama: BySplit
    augment: bool
    features: Count = Field(examples=[256])
    coordinates: bool
    clip: Positive = Field(examples=[1.0])
    geometric_baselines: bool
    geometric_height: ImageSide = Field(256, examples=[256])
    test_checkpoint: Literal["last", "best"]
    canvas: Canvas | None = None
    perspective_field: FieldPrediction | None = None

    @model_validator(mode="after")
    def _fields_are_of_canvases(self) -> Self:
        if self.perspective_field is not None and self.canvas is None:
            raise ValueError(
                "task.perspective_field needs pictures on a canvas, as experiment=calibration_held has: "
                "task.perspective_field=null"
            )
        return self

    @model_validator(mode="after")
    def _pictures_fit_their_canvas(self) -> Self:
        if self.canvas is not None and (self.width != self.height or self.width % 2):
            raise ValueError("task.canvas needs squares of an even number of pixels: task.width=112 task.height=112")
        if self.canvas is not None and self.geometric_baselines:
            raise ValueError("task.canvas has pictures of all shapes, which geometric methods do not see here: "
                             "task.geometric_baselines=false")  # fmt: skip
        return self


class PlaceRecognitionTask(TaskNode):
    """Place recognition by a descriptor."""

    needs = ("backbone", "inhibition", "loss", "pooling", "mining")
    loss_kind = PlaceLoss

    name: Literal["place_recognition"]
    dimension: int = Field(ge=1, le=65536, examples=[128])
    normalise: bool
    layer: str | None = Field(examples=["layer3"])
    batch_places: Count = Field(examples=[16])
    batch_conditions: int = Field(ge=2, le=64, examples=[4])
    tolerance: ToleranceByUnit
    test_tolerance: ToleranceByUnit
    train_conditions: list[str] | None = Field(examples=["[summer_noon,fog]"])
    test_conditions: list[str] | None = Field(examples=["[summer_noon,night_clear]"])
    shared_conditions: list[str] = Field(examples=["[summer_noon]"])
    augmentation: PlaceAugmentation
    clip: Positive = Field(examples=[1.0])
    whitening: Whitening | None = None
    sequence_length: Count = Field(examples=[10])
    baselines: bool
    off_the_shelf: OffTheShelf | None = None
    test_checkpoint: Literal["last", "best"]

    @model_validator(mode="after")
    def _whitened_last(self) -> Self:
        if self.whitening is not None and self.test_checkpoint == "best":
            raise ValueError(
                "whitening is solved for after the last epoch: test_checkpoint=best needs task.whitening=null"
            )
        if self.whitening is not None and self.whitening.components < self.dimension:
            raise ValueError(
                f"task.whitening.components={self.whitening.components} must be at least task.dimension="
                f"{self.dimension}"
            )
        return self


class LocalizationTask(TaskNode):
    """Localization in a map of images at known poses."""

    needs = ("kernel", "observation", "likelihood", "motion", "filter", "recovery", "fault", "descriptor")
    takes = ("faults", "backbone", "inhibition", "pooling")

    name: Literal["localization"]
    objective: Literal["joint", "vecchia"]
    images: int = Field(ge=10, le=100_000, examples=[600])
    neighbours: Count = Field(examples=[20])
    validation_images: Count = Field(examples=[200])
    validation_share: Share | None = Field(examples=[0.25])
    near_map: Positive | None = Field(examples=[0.6])
    odometry_scale: Annotated[float, Field(ge=0, le=100)] = Field(examples=[1.0])
    odometry_seed: Seed = Field(examples=[0])
    starts: Annotated[int, Field(ge=1, le=10_000)] = Field(examples=[32])
    horizon: Annotated[int, Field(ge=2, le=1_000_000)] = Field(examples=[150])
    every: Count = Field(examples=[1])
    particle_counts: (
        Annotated[list[Annotated[Count, Field(le=1_000_000)]], Field(min_length=1), AfterValidator(distinct)] | None
    ) = Field(examples=["[25,100,400]"])
    merge_duplicates: bool
    resolution_m: Annotated[float, Field(ge=0.005, le=10)] = Field(examples=[0.05])
    replay: bool
    save_map: bool
    test_checkpoint: Literal["last"]


class SceneChoice(Node):
    """Places as classes."""

    references: list[str] = Field(min_length=1, examples=["[summer_noon]"])
    queries: list[str] = Field(min_length=1, examples=["[autumn_rain,night_clear]"])
    spacing: Count = Field(examples=[5])
    neighbours: Annotated[int, Field(ge=0, le=1000)] = Field(examples=[0])
    tolerance: ToleranceByUnit


class FineTune(Node):
    """Fine-tuning of configured filters."""

    epochs: Annotated[int, Field(ge=0, le=100_000)] = Field(examples=[0])
    lr: Positive = Field(examples=[0.001])


class CosfireTask(TaskNode):
    """Recognition by filters configured from examples."""

    needs = ("features", "bank", "strategy", "filters")
    takes = ("backbone", "inhibition", "augmentation", "descriptor")

    name: Literal["cosfire"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    images: Count | None = Field(examples=[10000])
    novel_classes: Annotated[int, Field(ge=0, le=100_000)] = Field(examples=[5])
    examples: Count | None = Field(examples=[20])
    filters_per_class: Count = Field(examples=[10])
    at: Literal["random", "centre"]
    margin: Annotated[float, Field(ge=0, lt=0.5)] = Field(examples=[0.15])
    least_parts: Count = Field(examples=[2])
    methods: Annotated[list[RecognitionMethod], Field(min_length=1), AfterValidator(once)] = Field(
        examples=["[cosfire_svm,full_svm]"]
    )
    prices: Annotated[list[Positive], Field(min_length=1), AfterValidator(distinct)] = Field(examples=["[0.01,0.1,1]"])
    scalings: Annotated[
        list[Literal["all", "each", "unit"]], Field(min_length=1, examples=["[all]"]), AfterValidator(once)
    ]
    choose_among: Count = Field(examples=[1500])
    logarithms: bool
    tiles: Annotated[int, Field(ge=1, le=16)] = Field(examples=[2])
    fine_tune: FineTune
    scenes: SceneChoice | None
    test_every: Count = Field(examples=[1])
    test_checkpoint: Literal["last"]

    def answering(self) -> list[str]:
        """The methods whose answers a run has, if it has the parts for them."""
        return [*self.methods, "cosfire_tuned", "layer_tuned"] if self.fine_tune.epochs else list(self.methods)


Task = Annotated[
    ClassificationTask | CalibrationTask | PlaceRecognitionTask | LocalizationTask | CosfireTask,
    Field(discriminator="name"),
]


def owners() -> dict[str, list[str]]:
    """The groups that only some tasks use, with the names of these tasks."""
    found: dict[str, list[str]] = {}
    for task in get_args(get_args(Task)[0]):
        for group in (*task.needs, *task.takes):
            found.setdefault(group, []).extend(get_args(task.model_fields["name"].annotation))
    return found
