"""The typed config behind the YAML files: types, ranges and rules that join several keys.

Each config that Sextant ships has a model here, chosen by its ``_target_``. A ``_target_`` of the user's own is legal
everywhere: its arguments are then checked against its signature when it is built.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator


class Node(BaseModel):
    """A config node: exact types, no unknown keys, immutable."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Part(Node):
    """A config node that builds an object from an import path."""

    target: str = Field(alias="_target_")


class CustomPart(Part):
    """A part that Sextant does not know."""

    model_config = ConfigDict(extra="allow")


def _choose_part(*known: type[Part]) -> Discriminator:
    targets = {part.model_fields["target"].annotation.__args__[0] for part in known}  # type: ignore[union-attr]

    def tag(value: Any) -> str:
        target = str(value.get("_target_") if isinstance(value, dict) else value.target)
        return target if target in targets else "custom"

    return Discriminator(tag)


def _distinct(values: list[float]) -> list[float]:
    if len({f"{value:g}" for value in values}) < len(values):
        raise ValueError(f"values must differ, got {values}")
    return values


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1)]

# ---------------------------------------------------------------------------------------------------------- datasets


class Digits(Part):
    """scikit-learn's digit scans."""

    target: Literal["sextant.data.digits.Digits"] = Field(alias="_target_")
    size: int = Field(ge=12, le=512, examples=[28])


class MNIST(Part):
    """MNIST."""

    target: Literal["sextant.data.mnist.MNIST"] = Field(alias="_target_")
    download: bool


class FashionMNIST(Part):
    """Fashion-MNIST."""

    target: Literal["sextant.data.mnist.FashionMNIST"] = Field(alias="_target_")
    download: bool


class CIFAR10(Part):
    """CIFAR-10."""

    target: Literal["sextant.data.cifar10.CIFAR10"] = Field(alias="_target_")
    train_batches: int = Field(ge=1, le=5, examples=[5])
    download: bool


class ImageFolder(Part):
    """The user's own images."""

    target: Literal["sextant.data.image_folder.ImageFolder"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/images"])
    size: int = Field(ge=12, le=1024, examples=[64])
    channels: Literal[1, 3]
    test_fraction: Share = Field(examples=[0.2])


class BySplit(Node):
    """A number for each split."""

    train: Count = Field(examples=[400])
    val: Count = Field(examples=[60])
    test: Count = Field(examples=[100])


class FileBySplit(Node):
    """A file for each split, or none."""

    train: str | None = Field(examples=["kitti/poses/00.txt"])
    val: str | None = Field(examples=["kitti/poses/06.txt"])
    test: str | None = Field(examples=["kitti/poses/05.txt"])


ImageSide = Annotated[int, Field(ge=16, le=4096)]
Samples = Literal[1, 4, 9, 16]
BlockSide = Annotated[float, Field(ge=60, le=400)]
Conditions = Annotated[list[str | dict[str, Any]], Field(min_length=1, examples=["[summer_noon,winter_dusk]"])]


class TownPanoramas(Part):
    """Panoramas of procedural towns."""

    target: Literal["sextant.data.worlds.TownPanoramas"] = Field(alias="_target_")
    partial: bool = Field(alias="_partial_", default=False)
    images: BySplit
    towns: BySplit
    height: ImageSide = Field(examples=[512])
    samples: Samples = Field(examples=[4])
    conditions: Conditions
    size_m: Annotated[float, Field(ge=200, le=5000)] = Field(examples=[380.0])
    block_m: BlockSide = Field(examples=[85.0])
    seed: Seed = Field(examples=[0])

    @model_validator(mode="after")
    def _a_town_has_panoramas(self) -> Self:
        for split in ("train", "val", "test"):
            if getattr(self.towns, split) > getattr(self.images, split):
                raise ValueError(
                    f"dataset.towns.{split}={getattr(self.towns, split)} is more than dataset.images.{split}="
                    f"{getattr(self.images, split)}: a town needs a panorama"
                )
        return self


class ShareBySplit(Node):
    """A share for each split."""

    train: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.7])
    val: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.1])
    test: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.2])


class PanoramaFolder(Part):
    """The user's own panoramas."""

    target: Literal["sextant.data.calibration.PanoramaFolder"] = Field(alias="_target_")
    partial: bool = Field(alias="_partial_", default=False)
    folder: str = Field(examples=["/path/to/panoramas"])
    height: ImageSide = Field(examples=[512])
    fractions: ShareBySplit
    seed: Seed = Field(examples=[0])
    groups: str | None = Field(examples=["'^[^_]+'"])
    together: list[str] = Field(examples=["[house_a,house_b]"])


class PanoramaMix(Part):
    """Several sources of panoramas."""

    target: Literal["sextant.data.calibration.PanoramaMix"] = Field(alias="_target_")
    sources: dict[
        str,
        Annotated[
            Annotated[TownPanoramas, Tag("sextant.data.worlds.TownPanoramas")]
            | Annotated[PanoramaFolder, Tag("sextant.data.calibration.PanoramaFolder")],
            _choose_part(TownPanoramas, PanoramaFolder),
        ],
    ] = Field(min_length=1)
    repeats: dict[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict, examples=["{real: 2}"])


class TownSeasons(Part):
    """The same streets under several conditions."""

    target: Literal["sextant.data.worlds.TownSeasons"] = Field(alias="_target_")
    frames: BySplit
    step_m: Annotated[float, Field(ge=0.1, le=50)] = Field(examples=[3.0])
    lateral_sigma_m: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.3])
    heading_sigma_deg: Annotated[float, Field(ge=0, le=20)] = Field(examples=[2.0])
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[64])
    vfov_deg: Annotated[float, Field(ge=10, le=120)] = Field(examples=[55.0])
    samples: Samples = Field(examples=[4])
    conditions: Conditions
    block_m: BlockSide = Field(examples=[90.0])
    trajectories: FileBySplit
    seed: Seed = Field(examples=[0])


class TownCity(Part):
    """A city seen from everywhere."""

    target: Literal["sextant.data.worlds.TownCity"] = Field(alias="_target_")
    images: Count = Field(examples=[172000])
    headings: Annotated[int, Field(ge=1, le=72)] = Field(examples=[8])
    size_m: Annotated[float, Field(ge=300, le=10000)] = Field(examples=[2950.0])
    block_m: BlockSide = Field(examples=[92.0])
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[64])
    vfov_deg: Annotated[float, Field(ge=10, le=120)] = Field(examples=[55.0])
    samples: Samples = Field(examples=[1])
    conditions: Conditions
    query_frames: Annotated[int, Field(ge=0)] = Field(examples=[1000])
    query_step_m: Annotated[float, Field(ge=0.1, le=50)] = Field(examples=[2.0])
    seed: Seed = Field(examples=[0])


class Laser(Node):
    """A laser scanner."""

    beams: Annotated[int, Field(ge=1, le=10000)] = Field(examples=[180])
    field_of_view_rad: Annotated[float, Field(gt=0, le=6.2832)] = Field(examples=[3.1415])
    max_range_m: Positive = Field(examples=[15.0])
    range_sigma_m: NonNegative = Field(examples=[0.02])
    dropout: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.01])


class OfficeWalk(Part):
    """A robot in an office."""

    target: Literal["sextant.data.worlds.OfficeWalk"] = Field(alias="_target_")
    size_m: list[Annotated[float, Field(ge=9, le=200)]] = Field(min_length=2, max_length=2, examples=["[46.0,16.0]"])
    metres: list[Annotated[float, Field(gt=2, le=10000)]] = Field(min_length=2, examples=["[160.0,80.0]"])
    trajectories: list[str] = Field(examples=["[cold/map.json,cold/seq1_night1.json]"])
    every: Count = Field(examples=[2])
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[64])
    vfov_deg: Annotated[float, Field(ge=10, le=120)] = Field(examples=[60.0])
    samples: Samples = Field(examples=[4])
    conditions: Conditions
    laser: Laser
    seed: Seed = Field(examples=[0])


Dataset = Annotated[
    Annotated[Digits, Tag("sextant.data.digits.Digits")]
    | Annotated[MNIST, Tag("sextant.data.mnist.MNIST")]
    | Annotated[FashionMNIST, Tag("sextant.data.mnist.FashionMNIST")]
    | Annotated[CIFAR10, Tag("sextant.data.cifar10.CIFAR10")]
    | Annotated[ImageFolder, Tag("sextant.data.image_folder.ImageFolder")]
    | Annotated[TownPanoramas, Tag("sextant.data.worlds.TownPanoramas")]
    | Annotated[PanoramaFolder, Tag("sextant.data.calibration.PanoramaFolder")]
    | Annotated[PanoramaMix, Tag("sextant.data.calibration.PanoramaMix")]
    | Annotated[TownSeasons, Tag("sextant.data.worlds.TownSeasons")]
    | Annotated[TownCity, Tag("sextant.data.worlds.TownCity")]
    | Annotated[OfficeWalk, Tag("sextant.data.worlds.OfficeWalk")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(
        Digits,
        MNIST,
        FashionMNIST,
        CIFAR10,
        ImageFolder,
        TownPanoramas,
        PanoramaFolder,
        PanoramaMix,
        TownSeasons,
        TownCity,
        OfficeWalk,
    ),
]

# -------------------------------------------------------------------------------------------------------- corruptions


class GaussianNoise(Part):
    """Additive Gaussian noise."""

    target: Literal["sextant.corruptions.GaussianNoise"] = Field(alias="_target_")
    levels: Annotated[list[NonNegative], AfterValidator(_distinct)] = Field(min_length=1, examples=["[0.01,0.1]"])
    clip: bool


class ContrastPoisson(Part):
    """Loss of contrast, then photon noise."""

    target: Literal["sextant.corruptions.ContrastPoisson"] = Field(alias="_target_")
    levels: Annotated[list[Annotated[float, Field(gt=0, le=1)]], AfterValidator(_distinct)] = Field(
        min_length=1, examples=["[0.5,0.2]"]
    )
    peak: Positive = Field(examples=[256.0])
    clip: bool


CorruptionPart = Annotated[
    Annotated[GaussianNoise, Tag("sextant.corruptions.GaussianNoise")]
    | Annotated[ContrastPoisson, Tag("sextant.corruptions.ContrastPoisson")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(GaussianNoise, ContrastPoisson),
]


class CorruptionSuite(Part):
    """The test conditions."""

    target: Literal["sextant.corruptions.CorruptionSuite"] = Field(alias="_target_")
    corruptions: dict[str, CorruptionPart]
    seed: Seed = Field(examples=[0])


# ----------------------------------------------------------------------------------------------- networks and training


class LeNet(Part):
    """LeNet A to D."""

    target: Literal["sextant.models.LeNet"] = Field(alias="_target_")
    variant: Literal["A", "B", "C", "D"]


class StridedCNN(Part):
    """A small convolutional network."""

    target: Literal["sextant.models.StridedCNN"] = Field(alias="_target_")
    widths: list[Annotated[int, Field(ge=8, le=4096, multiple_of=8)]] = Field(min_length=2, examples=["[24,48,96]"])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[3,4]"])


class OrientedCNN(Part):
    """Convolutions on histograms of oriented gradients."""

    target: Literal["sextant.models.OrientedCNN"] = Field(alias="_target_")
    widths: list[Annotated[int, Field(ge=8, le=4096, multiple_of=8)]] = Field(min_length=1, examples=["[48,96,128]"])
    strides: list[Literal[1, 2]] = Field(min_length=1, examples=["[1,2,2]"])
    orientations: int = Field(ge=2, le=64, examples=[10])
    cell: int = Field(ge=1, le=32, examples=[4])
    grid: list[Count] = Field(min_length=2, max_length=2, examples=["[3,4]"])

    @model_validator(mode="after")
    def _a_stride_a_width(self) -> Self:
        if len(self.widths) != len(self.strides):
            raise ValueError(f"backbone.strides={self.strides} must have one entry for each of {self.widths}")
        return self


class TorchvisionBackbone(Part):
    """A torchvision network."""

    target: Literal["sextant.models.torchvision_backbone"] = Field(alias="_target_")
    name: str = Field(examples=["resnet18"])
    weights: str | None = Field(examples=["imagenet"])


class TimmBackbone(Part):
    """A timm network."""

    target: Literal["sextant.models.timm_backbone"] = Field(alias="_target_")
    name: str = Field(examples=["mobilenetv3_small_100"])
    pretrained: bool


Backbone = Annotated[
    Annotated[LeNet, Tag("sextant.models.LeNet")]
    | Annotated[StridedCNN, Tag("sextant.models.StridedCNN")]
    | Annotated[OrientedCNN, Tag("sextant.models.OrientedCNN")]
    | Annotated[TorchvisionBackbone, Tag("sextant.models.torchvision_backbone")]
    | Annotated[TimmBackbone, Tag("sextant.models.timm_backbone")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(LeNet, StridedCNN, OrientedCNN, TorchvisionBackbone, TimmBackbone),
]


class Parameterization(Part):
    """What a network predicts of a camera."""

    target: Literal["sextant.geometry.Parameterization"] = Field(alias="_target_")
    name: Literal["direct", "horizon", "undistorted_horizon"]
    k2_of_k1: Literal["lopez", "zero"]


class Sampling(Part):
    """A distribution of cameras."""

    model_config = ConfigDict(extra="allow")

    target: str = Field(alias="_target_")
    k2_of_k1: Literal["lopez", "zero"]


class ParameterLoss(Part):
    """Errors of the parameters."""

    target: Literal["sextant.losses.ParameterLoss"] = Field(alias="_target_")
    units: Literal["raw", "range", "natural"]
    penalty: Literal["l2", "huber"]
    delta: Positive = Field(examples=[0.1])


class BearingLoss(Part):
    """Errors of the rays."""

    target: Literal["sextant.losses.BearingLoss"] = Field(alias="_target_")
    mode: Literal["joint", "disentangled", "harmonic"]
    grid: int = Field(ge=2, le=64, examples=[7])


Loss = Annotated[
    Annotated[ParameterLoss, Tag("sextant.losses.ParameterLoss")]
    | Annotated[BearingLoss, Tag("sextant.losses.BearingLoss")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(ParameterLoss, BearingLoss),
]


class NoInhibition(Part):
    """The network as it is."""

    target: Literal["sextant.layers.NoInhibition"] = Field(alias="_target_")


class PushPullInhibition(Part):
    """Push-pull in place of the first convolution."""

    target: Literal["sextant.layers.PushPullInhibition"] = Field(alias="_target_")
    scale: float = Field(ge=1, le=8, examples=[2.0])
    alpha: NonNegative = Field(examples=[1.0])
    train_alpha: bool


Inhibition = Annotated[
    Annotated[NoInhibition, Tag("sextant.layers.NoInhibition")]
    | Annotated[PushPullInhibition, Tag("sextant.layers.PushPullInhibition")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(NoInhibition, PushPullInhibition),
]


class SGD(Part):
    """Stochastic gradient descent."""

    target: Literal["torch.optim.SGD"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.1])
    momentum: float = Field(ge=0, lt=1, examples=[0.9])
    nesterov: bool
    weight_decay: NonNegative = Field(examples=[0.0005])

    @model_validator(mode="after")
    def _nesterov_needs_momentum(self) -> Self:
        if self.nesterov and self.momentum == 0:
            raise ValueError("optimizer.nesterov=true needs optimizer.momentum above 0, for example 0.9")
        return self


class Adam(Part):
    """Adam."""

    target: Literal["torch.optim.Adam"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.001])
    betas: list[Annotated[float, Field(ge=0, lt=1)]] = Field(min_length=2, max_length=2, examples=["[0.9,0.999]"])
    weight_decay: NonNegative = Field(examples=[0.0])


class AdamW(Part):
    """AdamW."""

    target: Literal["torch.optim.AdamW"] = Field(alias="_target_")
    partial: Literal[True] = Field(alias="_partial_")
    lr: Positive = Field(examples=[0.001])
    betas: list[Annotated[float, Field(ge=0, lt=1)]] = Field(min_length=2, max_length=2, examples=["[0.9,0.999]"])
    weight_decay: NonNegative = Field(examples=[0.01])


Optimizer = Annotated[
    Annotated[SGD, Tag("torch.optim.SGD")]
    | Annotated[Adam, Tag("torch.optim.Adam")]
    | Annotated[AdamW, Tag("torch.optim.AdamW")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(SGD, Adam, AdamW),
]


class ConstantRate(Part):
    """The learning rate as it is."""

    target: Literal["sextant.tasks.schedules.ConstantRate"] = Field(alias="_target_")


class StepDecay(Part):
    """The learning rate in steps."""

    target: Literal["sextant.tasks.schedules.StepDecay"] = Field(alias="_target_")
    at: list[Share] = Field(examples=["[0.5,0.75]"])
    factor: Share = Field(examples=[0.1])

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if sorted(set(self.at)) != self.at:
            raise ValueError(f"schedule.at must ascend, got {self.at}")
        return self


class CosineDecay(Part):
    """The learning rate along half a cosine."""

    target: Literal["sextant.tasks.schedules.CosineDecay"] = Field(alias="_target_")


Schedule = Annotated[
    Annotated[ConstantRate, Tag("sextant.tasks.schedules.ConstantRate")]
    | Annotated[StepDecay, Tag("sextant.tasks.schedules.StepDecay")]
    | Annotated[CosineDecay, Tag("sextant.tasks.schedules.CosineDecay")]
    | Annotated[CustomPart, Tag("custom")],
    _choose_part(ConstantRate, StepDecay, CosineDecay),
]


class Trainer(Node):
    """How training runs."""

    accelerator: Literal["cpu", "gpu"]
    devices: int = Field(ge=1, le=1, examples=[1])
    precision: Literal["32-true", "16-mixed", "bf16-mixed"]
    deterministic: bool
    threads: int = Field(ge=1, le=256, examples=[1])
    max_epochs: Count = Field(examples=[12])
    batch_size: Count = Field(examples=[128])
    eval_batch_size: Count = Field(examples=[1000])
    log_every: int = Field(ge=20, examples=[50])
    workers: int = Field(ge=0, le=64, examples=[0])
    progress: bool

    @model_validator(mode="after")
    def _half_precision_needs_a_gpu(self) -> Self:
        if self.accelerator == "cpu" and self.precision == "16-mixed":
            raise ValueError("trainer.precision=16-mixed needs trainer=gpu; on the CPU use 32-true or bf16-mixed")
        return self


# -------------------------------------------------------------------------------------------------- tracking and paths


class Tracking(Node):
    """Where runs are logged."""

    kind: Literal["sqlite", "server", "none"]
    uri: str | None = Field(examples=["http://127.0.0.1:5000"])
    experiment: str | None = Field(examples=["lenet"])
    system_metrics: bool
    system_metrics_every_s: Positive = Field(examples=[10])
    log_checkpoint: bool
    parent_run: str | None

    @model_validator(mode="after")
    def _server_needs_an_address(self) -> Self:
        if self.kind == "server" and not (self.uri or "").startswith(("http://", "https://")):
            raise ValueError(
                f"tracking.uri={self.uri} must start with http:// or https://; "
                "for example tracking=server tracking.uri=http://127.0.0.1:5000"
            )
        if self.kind == "sqlite" and self.uri is not None:
            raise ValueError(
                f"tracking.uri={self.uri} belongs to tracking=server; the sqlite store lies in paths.outputs"
            )
        return self


class Paths(Node):
    """Where things lie."""

    data: str
    outputs: str
    cache: str


# --------------------------------------------------------------------------------------------------------------- tasks


class ClassificationTask(Node):
    """Image classification."""

    name: Literal["classification"]
    validation_fraction: Share = Field(examples=[0.1])
    split_seed: Seed = Field(examples=[0])
    test_checkpoint: Literal["last", "best"]


class CalibrationTask(Node):
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
    test_checkpoint: Literal["last", "best"]


Task = Annotated[ClassificationTask | CalibrationTask, Field(discriminator="name")]

# -------------------------------------------------------------------------------------------------------------- sweeps


def _first_seeds(value: Any) -> Any:
    """A number n of seeds stands for 0 to n - 1."""
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a number of seeds must be at least 1, got {value}")
        return list(range(value))
    return value


Seeds = Annotated[list[Seed], Field(min_length=1), AfterValidator(_distinct), BeforeValidator(_first_seeds)]


class Arm(Node):
    """One of the things that a sweep compares."""

    overrides: list[str]
    seed_offset: int = Field(default=0, ge=0)


class Contrast(Node):
    """Treatment against control, at the same seeds unless an arm shifts them."""

    treatment: str
    control: str


class Sweep(Node):
    """A named ablation: factors x arms x seeds. The digest leaves it out: it plans runs and changes none."""

    name: str = Field(pattern=r"^[A-Za-z0-9_-]+$", examples=["my_sweep"])
    question: str = ""
    factors: dict[str, Annotated[list[str | int | float | bool], Field(min_length=1)]] = Field(default_factory=dict)
    arms: dict[str, Arm] = Field(default_factory=dict)
    seeds: Seeds = Field(default=[0], examples=[8])
    contrasts: dict[str, Contrast] = Field(default_factory=dict)
    noise_floor: str | None = None
    published: dict[str, dict[str, dict[str, float]]] = Field(default_factory=dict)
    interval: Literal["t", "bootstrap"] = "t"

    @model_validator(mode="after")
    def _contrasts_name_arms(self) -> Self:
        for name, contrast in self.contrasts.items():
            for arm in (contrast.treatment, contrast.control):
                if arm not in self.arms:
                    raise ValueError(f"sweep.contrasts.{name} names the arm {arm!r}; arms are {', '.join(self.arms)}")
        if self.noise_floor is not None and self.noise_floor not in self.contrasts:
            raise ValueError(f"sweep.noise_floor={self.noise_floor} must be one of {', '.join(self.contrasts)}")
        return self


class Config(Node):
    """A whole run."""

    dataset: Dataset
    corruption: CorruptionSuite
    backbone: Backbone
    inhibition: Inhibition
    optimizer: Optimizer
    schedule: Schedule
    trainer: Trainer
    tracking: Tracking
    paths: Paths
    task: Task
    parameterization: Parameterization | None = None
    loss: Loss | None = None
    sampling: Sampling | None = None
    test_sampling: Sampling | None = None
    seed: Seed = Field(examples=[0])
    init_from: str | None
    reuse: Literal["exact", "any_code"]
    sweep: Sweep | None = None

    @model_validator(mode="after")
    def _groups_belong_to_the_task(self) -> Self:
        needed = ("parameterization", "loss", "sampling")
        if self.task.name == "calibration":
            for name in needed:
                if getattr(self, name) is None:
                    raise ValueError(f"{name} is missing: task=calibration needs one")
        else:
            for name in (*needed, "test_sampling"):
                if getattr(self, name) is not None:
                    raise ValueError(f"{name} belongs to task=calibration; leave it out, or choose that task")
        return self

    def custom_targets(self) -> list[str]:
        """Import paths in the config that Sextant has no schema for."""
        parts: list[Part] = [self.dataset, self.backbone, self.inhibition, self.optimizer, self.schedule]
        parts += self.corruption.corruptions.values()
        parts += [part for part in (self.loss,) if part is not None]
        return [part.target for part in parts if isinstance(part, CustomPart)]
