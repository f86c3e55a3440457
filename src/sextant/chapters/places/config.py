"""The config of place recognition: datasets, poolings, losses and mining."""

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from sextant.config.schema.images import Dataset
from sextant.config.schema.networks import Backbone, Inhibition
from sextant.config.schema.parts import Choice, Node, Part
from sextant.config.schema.run import Config, TaskNode
from sextant.ranges import Count, ImageSide, NonNegative, Positive, Seed

#: first frame, and the frame after the last
FrameRange = Annotated[list[Annotated[int, Field(ge=0)] | None], Field(min_length=2, max_length=2)]
Traverses = dict[str, str]


class Places(Dataset):
    """A dataset of places."""


class RangeBySplit(Node):
    """A range of frames for each split."""

    train: FrameRange = Field(examples=["[0,1600]"])
    val: FrameRange = Field(examples=["[1600,1650]"])
    test: FrameRange = Field(examples=["[1650,2400]"])


class Nordland(Places):
    """Aligned frames, with one folder per season."""

    target: Literal["sextant.chapters.places.data.Nordland"] = Field(alias="_target_")
    conditions: list[str] = Field(min_length=1, examples=["[summer,winter]"])
    frames: RangeBySplit
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[64])
    channels: Literal[1, 3]
    folder: str = Field(examples=["nordland"])
    skip_bad: bool


class PlaceFolders(Places):
    """The user's own places."""

    later = ("name",)
    target: Literal["sextant.chapters.places.data.PlaceFolders"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/places"])
    train: Traverses | None = Field(examples=["{summer: train/summer, winter: train/winter}"])
    val: Traverses | None = Field(examples=["{summer: val/summer, winter: val/winter}"])
    test: Traverses | None = Field(examples=["{reference: reference, query: query}"])
    places: Literal["csv", "utm", "gps", "order", "name"]
    csv: str = Field(examples=["poses.csv"])
    height: ImageSide = Field(examples=[64])
    width: ImageSide = Field(examples=[96])
    channels: Literal[1, 3]
    skip_bad: bool
    allow_duplicates: bool
    name: str | None = Field(default=None, min_length=1, examples=["my_streets"])


class Pooling(Part):
    """The pooling of a feature map to a vector."""


class Average(Pooling):
    """Means of the channels."""

    target: Literal["sextant.models.pooling.Average"] = Field(alias="_target_")


class GeM(Pooling):
    """Generalised means of the channels."""

    target: Literal["sextant.models.pooling.GeM"] = Field(alias="_target_")
    p: float = Field(ge=1, le=12, examples=[3.0])
    train_p: bool


class Flatten(Pooling):
    """All cells of all channels."""

    target: Literal["sextant.models.pooling.Flatten"] = Field(alias="_target_")
    grid: list[Count] | None = Field(min_length=2, max_length=2, examples=["[3,4]"])


class NetVLAD(Pooling):
    """Residuals to learnt centres."""

    target: Literal["sextant.models.pooling.NetVLAD"] = Field(alias="_target_")
    clusters: int = Field(ge=2, le=1024, examples=[16])


class CellsAndVLAD(Pooling):
    """Means over cells beside residuals to learnt centres."""

    target: Literal["sextant.models.pooling.CellsAndVLAD"] = Field(alias="_target_")
    clusters: int = Field(ge=2, le=1024, examples=[32])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[4,6]"])
    cells: float = Field(gt=0, examples=[1.0])


class FeatureMixer(Pooling):
    """Mixing of cells, then of channels."""

    target: Literal["sextant.models.pooling.FeatureMixer"] = Field(alias="_target_")
    out_channels: Count = Field(examples=[64])
    out_rows: Count = Field(examples=[4])
    depth: Count = Field(examples=[4])
    ratio: Positive = Field(examples=[1.0])


class PlaceLoss(Part):
    """A loss on place descriptors."""


class TripletRatioLoss(PlaceLoss):
    """The triplet ratio loss."""

    target: Literal["sextant.losses.TripletRatioLoss"] = Field(alias="_target_")
    margin: float = Field(ge=0.01, examples=[0.01])
    pair_weight: NonNegative = Field(examples=[0.0])


class TripletMarginLoss(PlaceLoss):
    """The triplet margin loss."""

    target: Literal["sextant.losses.TripletMarginLoss"] = Field(alias="_target_")
    margin: Positive = Field(examples=[0.1])
    squared: bool


class SoftMarginLoss(PlaceLoss):
    """The triplet margin loss with a smooth (soft) margin."""

    target: Literal["sextant.losses.SoftMarginLoss"] = Field(alias="_target_")
    scale: Positive = Field(examples=[1.0])


class ContrastiveLoss(PlaceLoss):
    """The contrastive loss."""

    target: Literal["sextant.losses.ContrastiveLoss"] = Field(alias="_target_")
    margin: Positive = Field(examples=[0.5])


class InfoNCELoss(PlaceLoss):
    """Cross-entropy of positives among negatives."""

    target: Literal["sextant.losses.InfoNCELoss"] = Field(alias="_target_")
    temperature: Positive = Field(examples=[0.07])


class MultiSimilarityLoss(PlaceLoss):
    """The multi-similarity loss."""

    target: Literal["sextant.losses.MultiSimilarityLoss"] = Field(alias="_target_")
    alpha: Positive = Field(examples=[2.0])
    beta: Positive = Field(examples=[50.0])
    base: float = Field(ge=-1, le=1, examples=[0.5])
    epsilon: NonNegative | None = Field(examples=[0.1])


class Mining(Part):
    """The selection of the images of a batch that a loss compares."""


class NoMining(Mining):
    """All pairs of a batch."""

    target: Literal["sextant.retrieval.NoMining"] = Field(alias="_target_")


class RandomMining(Mining):
    """Triplets drawn at random."""

    target: Literal["sextant.retrieval.RandomMining"] = Field(alias="_target_")
    per_anchor: Count = Field(examples=[1])


class SemiHardMining(Mining):
    """Negatives slightly further away than the positive."""

    target: Literal["sextant.retrieval.SemiHardMining"] = Field(alias="_target_")
    margin: Positive = Field(examples=[0.1])


class BatchHardMining(Mining):
    """The hardest examples of the batch."""

    target: Literal["sextant.retrieval.BatchHardMining"] = Field(alias="_target_")


class CachedHardMining(Mining):
    """The hardest examples of a sample of the training set."""

    target: Literal["sextant.retrieval.CachedHardMining"] = Field(alias="_target_")
    refresh: Count = Field(examples=[100])
    anchors: Count = Field(examples=[1000])
    candidates: Count = Field(examples=[1000])
    negatives: Count = Field(examples=[10])
    positive: Literal["nearest", "random", "furthest"]


class Tolerance(Node):
    """Distances within one place and between two places, in the unit given by its key."""

    positive: NonNegative = Field(examples=[5.0])
    negative: Positive = Field(examples=[25.0])
    heading_deg: Annotated[float, Field(gt=0, le=180)] | None = Field(examples=[40.0])

    @field_validator("negative")
    @classmethod
    def _a_ring_between(cls, negative: float, given: ValidationInfo) -> float:
        positive = given.data.get("positive")
        if positive is not None and positive >= negative:
            raise ValueError(f"positive={positive:g} must be below negative={negative:g}")
        return negative


class ToleranceByUnit(Node):
    """One tolerance for places known by position, and one for places known by frame."""

    m: Tolerance
    frames: Tolerance


class Whitening(Node):
    """Whitening: the last layer, computed in closed form after training."""

    components: Count = Field(examples=[256])
    shrinkage: Positive = Field(examples=[1.0])
    images: Count = Field(default=4000, examples=[4000])


class PlaceAugmentation(Node):
    """The strength of augmentation of training images."""

    later = ("augmix",)
    brightness: NonNegative = Field(examples=[0.3])
    contrast: NonNegative = Field(examples=[0.3])
    shift: float = Field(ge=0, lt=0.5, examples=[0.05])
    mirror: bool = False
    augmix: int | None = Field(default=None, ge=1, le=10, examples=[3])


class OffTheShelf(Node):
    """A layer of a network trained for another task."""

    weights: str = Field(min_length=1, examples=["alexnet.pth"])
    network: str | None = Field(default=None, examples=["alexnet"])
    layer: str | None = Field(default=None, examples=["features.7"])
    grid: list[Count] = Field(default=[4, 8], min_length=2, max_length=2, examples=["[4,8]"])
    dimension: int | None = Field(default=None, ge=1, le=65536, examples=[128])
    size: list[ImageSide] | None = Field(default=None, min_length=2, max_length=2, examples=["[224,224]"])

    @model_validator(mode="after")
    def _whose_weights(self) -> Self:
        if self.network is None and self.weights == "imagenet":
            raise ValueError(
                "task.off_the_shelf.weights=imagenet needs a network, for example network: alexnet, layer: features.7"
            )
        return self


#: x and y in pixels
Point = Annotated[list[float], Field(min_length=2, max_length=2)]


class Descriptor(Part):
    """An image descriptor."""


class PixelsDescriptor(Descriptor):
    """Standardised pixels."""

    target: Literal["sextant.baselines.Pixels"] = Field(alias="_target_")
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[48])


class PatchNormalisedDescriptor(Descriptor):
    """Patch-normalised pixels."""

    target: Literal["sextant.baselines.PatchNormalised"] = Field(alias="_target_")
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[48])


class HogDescriptor(Descriptor):
    """Histograms of oriented gradients."""

    target: Literal["sextant.baselines.Hog"] = Field(alias="_target_")
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[48])


class WhitenedPCADescriptor(Descriptor):
    """Whitened principal components of the map's pixels."""

    target: Literal["sextant.baselines.WhitenedPCA"] = Field(alias="_target_")
    height: ImageSide = Field(examples=[32])
    width: ImageSide = Field(examples=[48])
    dimensions: Count = Field(examples=[128])
    most_images: Count = Field(examples=[10000])


class LandmarksDescriptor(Descriptor):
    """Landmarks marked on a photo, alone or beside another descriptor."""

    target: Literal["sextant.chapters.cosfire.landmarks.Landmarks"] = Field(alias="_target_")
    photo: str = Field(examples=["photo.png"])
    points: Annotated[list[Point], Field(min_length=1)] = Field(examples=[[[310, 190], [120, 80]]])
    beside: str | None = Field(examples=["whitened_pca"])
    columns: Count = Field(examples=[8])
    reach: Positive = Field(examples=[0.25])
    weight: Positive = Field(examples=[1.0])
    network: str | None = Field(examples=["place_recognition/1a2b3c4d-s0"])


class NetworkDescriptor(Descriptor):
    """The network of the groups backbone and inhibition, without further training."""

    target: Literal["sextant.baselines.network_layer.NetworkLayer"] = Field(alias="_target_")
    layer: str | None = Field(examples=["layer3"])
    height: ImageSide = Field(examples=[64])
    width: ImageSide = Field(examples=[96])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[4,6]"])
    dimensions: Count | None = Field(examples=[128])
    seed: Seed = Field(examples=[0])


class TrainedDescriptor(Descriptor):
    """The network of a run of place recognition."""

    target: Literal["sextant.chapters.places.descriptors.TrainedDescriptor"] = Field(alias="_target_")
    run: str = Field(examples=["place_recognition/1a2b3c4d-s0"])


class DescriptorFiles(Descriptor):
    """Vectors that were computed elsewhere."""

    target: Literal["sextant.chapters.places.descriptors.DescriptorFiles"] = Field(alias="_target_")
    folder: str = Field(examples=["descriptors"])


class LocalFeatureSettings(Part):
    """Local features, by which matches are re-ranked."""

    keypoints: Count = Field(examples=[2048])
    side: Annotated[int, Field(ge=64, le=4096)] | None = Field(examples=[640])


class XFeatSettings(LocalFeatureSettings):
    """XFeat."""

    target: Literal["sextant.correspondence.XFeatures"] = Field(alias="_target_")


class TrunkSettings(LocalFeatureSettings):
    """Activations of the network that describes the images."""

    target: Literal["sextant.correspondence.TrunkFeatures"] = Field(alias="_target_")
    layers: list[str] | None = Field(min_length=1, examples=["[backbone.network.layer2]"])


class AlikedSettings(LocalFeatureSettings):
    """ALIKED, matched by LightGlue."""

    target: Literal["sextant.correspondence.AlikedFeatures"] = Field(alias="_target_")
    weights: str = Field(min_length=1, examples=["models/aliked"])


# -- task --------------------------------------------------------------------------------------------------------------


class PlaceRecognitionTask(TaskNode):
    """Place recognition by a descriptor."""

    later = ("rerank",)
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
    rerank: Count | None = Field(default=None, examples=[15])
    off_the_shelf: OffTheShelf | None = None
    test_checkpoint: Literal["last", "best"]

    @model_validator(mode="after")
    def _whitened_last(self) -> Self:
        if self.whitening is not None and self.test_checkpoint == "best":
            raise ValueError(
                "whitening is computed after the last epoch: test_checkpoint=best needs task.whitening=null"
            )
        if self.whitening is not None and self.whitening.components < self.dimension:
            raise ValueError(
                f"task.whitening.components={self.whitening.components} must be at least task.dimension="
                f"{self.dimension}"
            )
        return self


class DescribingConfig(Config):
    """The config of runs of other tasks that describe images."""

    descriptor: Choice[Descriptor] | None = None
    backbone: Choice[Backbone] | None = None
    inhibition: Choice[Inhibition] | None = None


class PlacesConfig(Config):
    """The config of a run of place recognition."""

    task: PlaceRecognitionTask
    backbone: Choice[Backbone]
    inhibition: Choice[Inhibition]
    loss: Choice[PlaceLoss]
    pooling: Choice[Pooling]
    mining: Choice[Mining]
    local: Choice[LocalFeatureSettings] | None = None


CONFIG = PlacesConfig
