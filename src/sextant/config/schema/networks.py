"""Networks, and the inhibition layers put into them."""

from typing import Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import Part
from sextant.ranges import Channels, Count, NonNegative, Positive


class Backbone(Part):
    """A network."""


class LeNet(Backbone):
    """LeNet A to D."""

    target: Literal["sextant.models.LeNet"] = Field(alias="_target_")
    variant: Literal["A", "B", "C", "D"]


class ResNetCifar(Backbone):
    """ResNet for CIFAR."""

    target: Literal["sextant.models.ResNetCifar"] = Field(alias="_target_")
    depth: int = Field(ge=8, le=1202, examples=[20])

    @model_validator(mode="after")
    def _whole_stages(self) -> Self:
        if (self.depth - 2) % 6:
            raise ValueError(f"backbone.depth={self.depth} must be 6 n + 2, for example 20, 32, 44 or 56")
        return self


class DenseNetCifar(Backbone):
    """DenseNet-BC for CIFAR."""

    target: Literal["sextant.models.DenseNetCifar"] = Field(alias="_target_")
    depth: int = Field(ge=10, le=1000, examples=[40])
    growth: Count = Field(examples=[12])

    @model_validator(mode="after")
    def _whole_blocks(self) -> Self:
        if (self.depth - 4) % 6:
            raise ValueError(f"backbone.depth={self.depth} must be 6 n + 4, for example 40 or 100")
        return self


class AlexNetCifar(Backbone):
    """AlexNet for CIFAR."""

    target: Literal["sextant.models.AlexNetCifar"] = Field(alias="_target_")
    hidden: Count = Field(examples=[4096])
    dropout: float = Field(ge=0, lt=1, examples=[0.5])


class StridedCNN(Backbone):
    """A small convolutional network."""

    target: Literal["sextant.models.StridedCNN"] = Field(alias="_target_")
    widths: list[Channels] = Field(min_length=2, examples=["[24,48,96]"])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[3,4]"])


class OrientedCNN(Backbone):
    """Convolutions on histograms of oriented gradients."""

    target: Literal["sextant.models.OrientedCNN"] = Field(alias="_target_")
    widths: list[Channels] = Field(min_length=1, examples=["[48,96,128]"])
    strides: list[Literal[1, 2]] = Field(min_length=1, examples=["[1,2,2]"])
    orientations: int = Field(ge=2, le=64, examples=[10])
    cell: int = Field(ge=1, le=32, examples=[4])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[3,4]"])

    @model_validator(mode="after")
    def _a_stride_a_width(self) -> Self:
        if len(self.widths) != len(self.strides):
            raise ValueError(f"backbone.strides={self.strides} must have one entry for each of {self.widths}")
        return self


class PlaceCNN(Backbone):
    """A small network for places."""

    target: Literal["sextant.models.PlaceCNN"] = Field(alias="_target_")
    widths: list[Channels] = Field(min_length=1, examples=["[32,64,96]"])
    strides: list[Literal[1, 2]] = Field(min_length=1, examples=["[1,2,2]"])
    window: int | None = Field(ge=3, le=255, examples=[9])

    @model_validator(mode="after")
    def _a_stride_a_width(self) -> Self:
        if len(self.widths) != len(self.strides):
            raise ValueError(f"backbone.strides={self.strides} must have one entry for each of {self.widths}")
        if self.window is not None and self.window % 2 == 0:
            raise ValueError(f"backbone.window={self.window} must be odd")
        return self


class SmallVGG(Backbone):
    """A VGG-like network with stages of convolutions."""

    target: Literal["sextant.models.SmallVGG"] = Field(alias="_target_")
    widths: list[Count] = Field(min_length=1, examples=["[16,32,64]"])
    depths: list[Count] = Field(min_length=1, examples=["[1,2,2]"])

    @model_validator(mode="after")
    def _a_depth_a_width(self) -> Self:
        if len(self.widths) != len(self.depths):
            raise ValueError(f"backbone.depths={self.depths} must have one entry for each of {self.widths}")
        return self


class CaffeNet(Backbone):
    """The convolutions of AlexNet as in Caffe."""

    target: Literal["sextant.models.CaffeNet"] = Field(alias="_target_")


class EfficientNetLite0(Backbone):
    """EfficientNet-Lite0 and its weights."""

    target: Literal["sextant.models.EfficientNetLite0"] = Field(alias="_target_")
    stages: int = Field(ge=1, le=8, examples=[5])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[3,4]"])
    weights: Literal["imagenet"] | None = Field(examples=["imagenet"])
    frozen_stages: int = Field(ge=0, le=8, examples=[3])
    rate_decay: float = Field(gt=0, le=1, examples=[0.7])

    @model_validator(mode="after")
    def _frozen_are_kept(self) -> Self:
        if self.frozen_stages > self.stages:
            raise ValueError(
                f"backbone.frozen_stages={self.frozen_stages} must be at most backbone.stages={self.stages}"
            )
        return self


class TorchvisionBackbone(Backbone):
    """A torchvision network."""

    target: Literal["sextant.models.torchvision_backbone"] = Field(alias="_target_")
    name: str = Field(examples=["resnet18"])
    weights: str | None = Field(examples=["imagenet"])


class TimmBackbone(Backbone):
    """A timm network."""

    later = ("weights",)
    target: Literal["sextant.models.timm_backbone"] = Field(alias="_target_")
    name: str = Field(examples=["mobilenetv3_small_100"])
    pretrained: bool
    weights: str | None = Field(default=None, examples=["mobilenetv3_small_100.safetensors"])

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        if self.pretrained and self.weights is not None:
            raise ValueError("backbone.pretrained=true fetches weights: leave out backbone.weights, or set it to false")
        return self


class RobustBenchNet(Backbone):
    """A network of RobustBench for CIFAR."""

    target: Literal["sextant.models.robustbench_net"] = Field(alias="_target_")
    kind: Literal["wide_resnet", "resnext", "resnet18"]
    depth: int = Field(ge=10, le=1000, examples=[28])
    width: Count = Field(examples=[10])
    groups: Count = 1
    mean: list[float] = Field(min_length=3, max_length=3, examples=["[0.5,0.5,0.5]"])
    std: list[Positive] = Field(min_length=3, max_length=3, examples=["[0.5,0.5,0.5]"])


class TimmClassifier(Backbone):
    """A timm network with its standardisation."""

    target: Literal["sextant.models.TimmClassifier"] = Field(alias="_target_")
    name: str
    mean: list[float] = Field(min_length=3, max_length=3, examples=["[0.485,0.456,0.406]"])
    std: list[Positive] = Field(min_length=3, max_length=3, examples=["[0.229,0.224,0.225]"])


class PublishedPlaceNet(Backbone):
    """A network for places that others published; its settings come from its file."""

    target: Literal["sextant.models.published_place_net.PublishedPlaceNet"] = Field(alias="_target_")
    kind: Literal["boq", "salad", "megaloc", "mixvpr", "cosplace", "netvlad"]
    trunk: Literal["vit", "resnet_basic", "resnet_bottleneck", "vgg16"]
    blocks: list[Count] = Field(max_length=4)
    sizes: dict[str, Count]


class OnnxPlaceNet(Backbone):
    """A network for places in an ONNX file; its settings come from the file."""

    target: Literal["sextant.models.onnx_place_net.OnnxPlaceNet"] = Field(alias="_target_")
    length: Count
    standardized: bool


class Inhibition(Part):
    """Layers that replace convolutions of a network."""


class NoInhibition(Inhibition):
    """The network unchanged."""

    target: Literal["sextant.layers.NoInhibition"] = Field(alias="_target_")


class PushPullInhibition(Inhibition):
    """Push-pull in place of convolutions."""

    target: Literal["sextant.layers.PushPullInhibition"] = Field(alias="_target_")
    where: str = Field(default="first", min_length=1, examples=["first_block"])
    scale: float = Field(ge=1, le=8, examples=[2.0])
    alpha: NonNegative = Field(examples=[1.0])
    train_alpha: bool
    impl: Literal["auto", "direct", "rows", "factorised"] = "auto"


class PushPullAvgInhibition(Inhibition):
    """The push-pull layer of 2024 in place of convolutions."""

    target: Literal["sextant.layers.PushPullAvgInhibition"] = Field(alias="_target_")
    where: str = Field(min_length=1, examples=["first_block"])
    average: int = Field(ge=1, le=31, examples=[3])
    alpha: NonNegative = Field(examples=[1.0])
    train_alpha: bool
    impl: Literal["box", "direct"]


class AntiAliasing(Inhibition):
    """A blur before every subsampling."""

    target: Literal["sextant.layers.AntiAliasing"] = Field(alias="_target_")
    taps: Count = Field(examples=[3])
