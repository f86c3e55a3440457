"""The config of calibration: distributions of cameras, losses, and datasets."""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from sextant.config.schema.images import Dataset
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.parts import CHOSEN_BY_TARGET, Choice, Node, Part
from sextant.config.schema.run import Config, TaskNode
from sextant.config.schema.splits import BlockSide, BySplit, Conditions, Samples, Streets
from sextant.config.schema.world_datasets import require_one_seed
from sextant.ranges import Count, ImageSide, Positive, Seed


class Parameterization(Part):
    """The quantities of a camera that a network predicts."""

    target: Literal["sextant.geometry.Parameterization"] = Field(alias="_target_")
    name: Literal["direct", "angles", "horizon", "undistorted_horizon"]
    k2_of_k1: Literal["lopez", "zero"]


class Sampling(Part):
    """A distribution of cameras."""

    model_config = ConfigDict(extra="allow")

    target: Literal["sextant.chapters.calibration.data.CameraDistribution"] | str = Field(alias="_target_")
    k2_of_k1: Literal["lopez", "zero"]


class CameraLoss(Part):
    """A loss on predicted cameras."""


class ParameterLoss(CameraLoss):
    """Loss on errors of the camera parameters."""

    target: Literal["sextant.losses.ParameterLoss"] = Field(alias="_target_")
    units: Literal["raw", "range", "natural", "learned"]
    penalty: Literal["l2", "huber"]
    delta: Positive = Field(examples=[0.1])


class BearingLoss(CameraLoss):
    """Loss on errors of the rays."""

    target: Literal["sextant.losses.BearingLoss"] = Field(alias="_target_")
    mode: Literal["joint", "disentangled", "harmonic"]
    grid: int = Field(ge=2, le=64, examples=[7])


class PoseLensLoss(CameraLoss):
    """Loss on errors of the direction of gravity and of the lens."""

    target: Literal["sextant.losses.PoseLensLoss"] = Field(alias="_target_")
    focal_weight: Positive = Field(examples=[0.5])
    bend_weight: Positive = Field(examples=[0.5])


class Canvas(Node):
    """Low-passed photos on a square canvas."""

    lines: Positive = Field(examples=[96])
    detail: list[Positive] = Field(min_length=2, max_length=2, examples=["[40,224]"])


class FieldPrediction(Node):
    """Training on the perspective field of a picture."""

    weight: Positive = Field(examples=[0.1])


class Panoramas(Dataset):
    """A dataset of panoramas."""


class TownPanoramas(Panoramas):
    """Panoramas of procedural towns."""

    later = ("streets", "world")
    target: Literal["sextant.data.worlds.TownPanoramas"] = Field(alias="_target_")
    partial: bool = Field(alias="_partial_", default=False)
    images: BySplit
    towns: BySplit
    height: ImageSide = Field(examples=[512])
    samples: Samples = Field(examples=[4])
    conditions: Conditions
    size_m: Annotated[float, Field(ge=200, le=5000)] = Field(examples=[380.0])
    block_m: BlockSide = Field(examples=[85.0])
    streets: Streets = None
    seed: Seed = Field(examples=[0])
    world: Seed | None = Field(None, examples=[3])

    @model_validator(mode="after")
    def _a_town_has_panoramas(self) -> Self:
        require_one_seed(self.seed, self.world)
        for split in ("train", "val", "test"):
            if getattr(self.towns, split) > getattr(self.images, split):
                raise ValueError(
                    f"dataset.towns.{split}={getattr(self.towns, split)} is more than dataset.images.{split}="
                    f"{getattr(self.images, split)}: each town needs a panorama"
                )
        return self


class ShareBySplit(Node):
    """A share for each split."""

    train: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.7])
    val: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.1])
    test: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.2])


class PanoramaFolder(Panoramas):
    """The user's own panoramas."""

    target: Literal["sextant.chapters.calibration.data.PanoramaFolder"] = Field(alias="_target_")
    partial: bool = Field(alias="_partial_", default=False)
    folder: str = Field(examples=["/path/to/panoramas"])
    height: ImageSide = Field(examples=[512])
    fractions: ShareBySplit
    seed: Seed = Field(examples=[0])
    groups: str | None = Field(examples=["'^[^_]+'"])
    together: list[str] = Field(examples=["[house_a,house_b]"])


class PanoramaMix(Panoramas):
    """Several sources of panoramas."""

    target: Literal["sextant.chapters.calibration.data.PanoramaMix"] = Field(alias="_target_")
    sources: dict[
        str,
        Annotated[TownPanoramas | PanoramaFolder, CHOSEN_BY_TARGET],
    ] = Field(min_length=1)
    repeats: dict[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict, examples=["{real: 2}"])


class CalibrationTask(TaskNode):
    """Calibration from one image."""

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
                "task.perspective_field needs pictures on a canvas, as in experiment=calibration_held: "
                "task.perspective_field=null"
            )
        return self

    @model_validator(mode="after")
    def _pictures_fit_their_canvas(self) -> Self:
        if self.canvas is not None and (self.width != self.height or self.width % 2):
            raise ValueError("task.canvas needs squares of an even number of pixels: task.width=112 task.height=112")
        if self.canvas is not None and self.geometric_baselines:
            raise ValueError("task.canvas mixes picture shapes, which the geometric baselines do not support: "
                             "task.geometric_baselines=false")  # fmt: skip
        return self


class CalibrationConfig(Config):
    """The config of a run of calibration."""

    task: CalibrationTask
    backbone: Choice[Backbone]
    inhibition: Choice[Inhibition]
    parameterization: Parameterization
    loss: Choice[CameraLoss]
    sampling: Sampling
    test_sampling: Sampling | None = None


CONFIG = CalibrationConfig
