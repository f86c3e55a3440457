"""The config of localization: datasets, faults, and the parts of map and filter."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from sextant.chapters.places.config import DescribingConfig, Descriptor, LocalFeatureSettings, Pooling, Traverses
from sextant.config.schema.images import Dataset
from sextant.config.schema.parts import Choice, Node, Part, distinct
from sextant.config.schema.run import TaskNode
from sextant.ranges import Count, ImageSide, NonNegative, Positive, Seed, Share


class Drives(Dataset):
    """A dataset of drives with poses."""


class PoseFolder(Drives):
    """The user's own drives with poses."""

    target: Literal["sextant.chapters.localization.data.PoseFolder"] = Field(alias="_target_")
    folder: str = Field(examples=["/path/to/drives"])
    map: str = Field(examples=["map"])
    test: Traverses | None = Field(min_length=1, examples=["{run: run}"])
    validation: Traverses | None = Field(min_length=1, examples=["{first: first}"])
    poses: Literal["csv", "tum", "kitti", "colmap", "opensfm", "nerfstudio", "gps", "euroc", "robotcar", "nclt"]
    pose_file: str | None = Field(examples=["poses.csv"])
    odometry: str | None = Field(examples=["odometry.csv"])
    times: str | None = Field(examples=["names"])
    plane: Literal["xy", "xz", "yz"]
    ahead: Literal["x", "z"]
    mounting: list[float] = Field(min_length=3, max_length=3, examples=["[0.0,0.0,0.0]"])
    protocol: Literal["office", "town"]
    max_gap_s: Positive | None = Field(examples=[5.0])
    height: ImageSide = Field(examples=[64])
    width: ImageSide = Field(examples=[96])
    channels: Literal[1, 3]
    skip_bad: bool


Frame = Annotated[float, Field(gt=0)]
#: a share, including 0 and 1
Portion = Annotated[float, Field(ge=0, le=1)]


class Fault(Part):
    """A fault."""


class NoFault(Fault):
    """No fault."""

    target: Literal["sextant.chapters.localization.data.faults.NoFault"] = Field(alias="_target_")


class Kidnap(Fault):
    """A kidnapped robot, carried elsewhere."""

    target: Literal["sextant.chapters.localization.data.faults.Kidnap"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    distance: NonNegative = Field(examples=[10.0])
    after: Count | None = Field(examples=[100])


class WrongStart(Fault):
    """The filter starts around a wrong pose."""

    target: Literal["sextant.chapters.localization.data.faults.WrongStart"] = Field(alias="_target_")
    distance: NonNegative = Field(examples=[5.0])
    heading_deg: Annotated[float, Field(ge=0, le=180)] = Field(examples=[90.0])


class DroppedFrames(Fault):
    """Images are lost at random."""

    target: Literal["sextant.chapters.localization.data.faults.DroppedFrames"] = Field(alias="_target_")
    share: Portion = Field(examples=[0.5])


class Blackout(Fault):
    """No image arrives for a while."""

    target: Literal["sextant.chapters.localization.data.faults.Blackout"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[30])


class OdometryScale(Fault):
    """Wrong odometry scale, as from wheels of another size."""

    target: Literal["sextant.chapters.localization.data.faults.OdometryScale"] = Field(alias="_target_")
    factor: Positive = Field(examples=[1.1])
    turn: Positive = Field(examples=[1.0])


class OdometrySlip(Fault):
    """Slipping wheels."""

    target: Literal["sextant.chapters.localization.data.faults.OdometrySlip"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[20])
    kind: Literal["spinning", "sliding"]


class MissingOdometry(Fault):
    """Odometry is missing for a while."""

    target: Literal["sextant.chapters.localization.data.faults.MissingOdometry"] = Field(alias="_target_")
    frame: Frame = Field(examples=[0.5])
    length: Count = Field(examples=[10])


class NoisyMapPoses(Fault):
    """Noise in the poses of the map images."""

    target: Literal["sextant.chapters.localization.data.faults.NoisyMapPoses"] = Field(alias="_target_")
    position: NonNegative = Field(examples=[0.5])
    heading_deg: NonNegative = Field(examples=[5.0])


class ThinnedMap(Fault):
    """A map with fewer images."""

    target: Literal["sextant.chapters.localization.data.faults.ThinnedMap"] = Field(alias="_target_")
    keep: Annotated[float, Field(gt=0, le=1)] = Field(examples=[0.25])


class WrongSeasonMap(Fault):
    """A map made under another condition."""

    target: Literal["sextant.chapters.localization.data.faults.WrongSeasonMap"] = Field(alias="_target_")
    condition: str = Field(examples=["winter_noon"])


class FaultSuite(Node):
    """Several faults, each tested in runs of its own."""

    faults: Annotated[dict[str, Choice[Fault]], Field(min_length=1)]


# -- observation -------------------------------------------------------------------------------------------------------


class Observation(Part):
    """An observation model: the likelihood of an image or scan at a pose."""


class ExactGP(Observation):
    """The whole Gaussian process."""

    target: Literal["sextant.localization.observation.ExactGP"] = Field(alias="_target_")


class LocalGP(Observation):
    """A Gaussian process over the map images nearest to each pose."""

    target: Literal["sextant.localization.observation.LocalGP"] = Field(alias="_target_")
    neighbours: Count = Field(examples=[16])
    neighbourhood: Literal["own", "nearest_image"]


class CachedLocalGP(Observation):
    """The local Gaussian process with its neighbourhoods solved once."""

    target: Literal["sextant.localization.observation.CachedLocalGP"] = Field(alias="_target_")
    neighbours: Count = Field(examples=[16])
    blend: Count = Field(examples=[1])
    map_evidence: Literal["image", "mean"]
    rounded: bool = False


class KernelMixture(Observation):
    """A mixture of cached local Gaussian processes with several length scales of the heading."""

    target: Literal["sextant.localization.observation.KernelMixture"] = Field(alias="_target_")
    neighbours: Count = Field(examples=[16])
    map_evidence: Literal["image", "mean"]
    headings: Annotated[list[Positive], Field(min_length=1)] = Field(examples=["[1.0,4.0]"])
    rounded: bool = False


class SGPR(Observation):
    """A sparse Gaussian process with inducing poses, in closed form."""

    target: Literal["sextant.localization.observation.SGPR"] = Field(alias="_target_")
    inducing: Count = Field(examples=[200])
    seed: Seed = Field(examples=[0])


class SVGP(Observation):
    """A sparse Gaussian process with inducing poses, fitted by minibatches."""

    target: Literal["sextant.localization.observation.SVGP"] = Field(alias="_target_")
    inducing: Count = Field(examples=[200])
    steps: Count = Field(examples=[200])
    batch: Count = Field(examples=[256])
    seed: Seed = Field(examples=[0])


class SKI(Observation):
    """Interpolation on a grid of poses."""

    target: Literal["sextant.localization.observation.SKI"] = Field(alias="_target_")
    spacing: Annotated[float, Field(gt=0, le=1)] = Field(examples=[0.5])
    rank: Annotated[int, Field(ge=2)] = Field(examples=[200])
    seed: Seed = Field(examples=[0])


class RandomFeatures(Observation):
    """Random Fourier features."""

    target: Literal["sextant.localization.observation.RandomFeatures"] = Field(alias="_target_")
    features: int = Field(ge=2, multiple_of=2, examples=[1000])
    seed: Seed = Field(examples=[0])


class KernelSum(Observation):
    """The kernel sum of a competing method."""

    target: Literal["sextant.localization.observation.KernelSum"] = Field(alias="_target_")
    neighbours: Count = Field(examples=[3])


class LikelihoodField(Observation):
    """A laser model based on the distance of end points from the nearest obstacle."""

    target: Literal["sextant.localization.laser.LikelihoodField"] = Field(alias="_target_")
    sigma_m: Positive = Field(examples=[0.2])
    z_hit: Share = Field(examples=[0.5])
    z_rand: Share = Field(examples=[0.5])
    max_distance_m: Positive = Field(examples=[2.0])
    unknown: Literal["distance", "random"]
    beams: Count = Field(examples=[60])


class BeamModel(Observation):
    """A laser model based on rays cast in the grid."""

    target: Literal["sextant.localization.laser.BeamModel"] = Field(alias="_target_")
    z_hit: Share = Field(examples=[0.5])
    z_short: Share = Field(examples=[0.05])
    z_max: Share = Field(examples=[0.05])
    z_rand: Share = Field(examples=[0.5])
    sigma_hit: Positive = Field(examples=[0.2])
    lambda_short: Positive = Field(examples=[0.1])
    beams: Count = Field(examples=[60])


#: laser models, which need a grid and scans
LASERS = (LikelihoodField, BeamModel)


class Sharper(Node):
    """Sharpening of a kernel after training.

    Attributes:
        length: factor of its length scales in x and y.
        noise: upper bound of its noise variance, as a share of the signal variance.
        heading: factor of its length scale in the heading.
    """

    length: Annotated[float, Field(gt=0, le=1)] = Field(examples=[0.5])
    noise: NonNegative = Field(examples=[0.001])
    heading: Annotated[float, Field(gt=0, le=10)] = Field(default=1.0, examples=[1.6])


class PoseKernel(Node):
    """The covariance kernel of descriptors over poses."""

    later = ("sharper",)

    spatial: Literal["rbf", "matern32", "matern52"]
    ard: bool
    sharper: Sharper | None = None


class Likelihood(Node):
    """The form of the likelihood, and which of its parameters are fitted to a validation traverse."""

    form: Literal["full", "univariate", "student"]
    dof: Positive = Field(examples=[4.0])
    tempering: Annotated[float, Field(gt=0, le=1)] | Literal["fitted", "along_drives"] = Field(examples=["fitted"])
    appearance_noise: NonNegative | Literal["fitted"] = Field(examples=["fitted"])
    whitening: bool


# -- filter ------------------------------------------------------------------------------------------------------------

Triple = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]


class Motion(Part):
    """A motion model."""


class ExponentialMotion(Motion):
    """Noise in se(2)."""

    target: Literal["sextant.localization.motion.ExponentialMotion"] = Field(alias="_target_")
    per_step: Triple = Field(examples=["[0.02,0.01,0.015]"])
    per_metre: Triple = Field(examples=["[0.002,0.0004,0.0004]"])
    per_radian: Triple = Field(examples=["[0.0,0.0004,0.0001]"])
    unknown: Triple | None = Field(default=None, examples=["[0.5,0.2,0.2]"])


class OdometryMotion(Motion):
    """Odometry noise in a rotation, a translation and a rotation."""

    target: Literal["sextant.localization.motion.OdometryMotion"] = Field(alias="_target_")
    alphas: Annotated[list[NonNegative], Field(min_length=4, max_length=4)] = Field(examples=["[0.2,0.2,0.2,0.2]"])
    least_translation: NonNegative = Field(default=0.01, examples=[0.01])
    unknown: Triple = Field(default=[0.5, 0.2, 0.2], examples=["[0.5,0.2,0.2]"])


class SpacingMotion(Motion):
    """Noise as a share of the spacing of the map's images."""

    target: Literal["sextant.localization.motion.motion_of_spacing"] = Field(alias="_target_")


class IdentityMotion(Motion):
    """A robot that does not move."""

    target: Literal["sextant.localization.motion.IdentityMotion"] = Field(alias="_target_")


class Recovery(Part):
    """Recovery of a lost filter."""


class NoRecovery(Recovery):
    """No recovery."""

    target: Literal["sextant.localization.recovery.NoRecovery"] = Field(alias="_target_")


class UniformInjection(Recovery):
    """A share of particles drawn from anywhere."""

    target: Literal["sextant.localization.recovery.UniformInjection"] = Field(alias="_target_")
    share: Share = Field(examples=[0.05])


class AugmentedMCL(Recovery):
    """Particles drawn from anywhere when the likelihood falls."""

    target: Literal["sextant.localization.recovery.AugmentedMCL"] = Field(alias="_target_")
    alpha_slow: Share = Field(examples=[0.001])
    alpha_fast: Share = Field(examples=[0.1])
    average: Literal["geometric", "arithmetic"]
    most: Share = Field(examples=[0.5])


class TopKInjection(Recovery):
    """Particles at the best matching map images, weighted by the same observation again."""

    target: Literal["sextant.localization.recovery.TopKInjection"] = Field(alias="_target_")
    share: Share = Field(examples=[0.1])
    top: Count = Field(examples=[10])


class BayesRestart(Recovery):
    """Particles at the best matching map images, weighted by the probability of a kidnapping."""

    target: Literal["sextant.localization.recovery.BayesRestart"] = Field(alias="_target_")
    hazard: Share = Field(examples=[0.001])
    share: Share = Field(examples=[0.1])
    weigh_jitter: bool
    window: Annotated[int, Field(ge=0, le=1000)] = Field(0, examples=[20])


class KLDSize(Node):
    """Adaptive number of particles (KLD-sampling)."""

    epsilon: Share = Field(examples=[0.05])
    confidence: Share = Field(examples=[0.99])
    bin_position: Positive = Field(examples=[0.5])
    bin_heading_deg: Annotated[float, Field(gt=0, le=180)] = Field(examples=[10.0])
    least: Count = Field(examples=[100])
    most: Count = Field(examples=[5000])

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.least > self.most:
            raise ValueError(f"filter.kld.least={self.least} must be at most filter.kld.most={self.most}")
        return self


class ParticleFilter(Node):
    """The particle filter."""

    later = ("support", "outliers", "apart", "regions", "best", "odds", "metric")
    particles: Annotated[int, Field(ge=1, le=1_000_000)] = Field(examples=[1000])
    start: Literal["uniform", "appearance", "gaussian"]
    resampling: Literal["systematic", "stratified", "residual", "multinomial"]
    ess_threshold: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.5])
    kld: KLDSize | None
    spread_position: Positive | None = Field(examples=[0.3])
    spread_heading_deg: Annotated[float, Field(ge=0, le=180)] | None = Field(examples=[10.0])
    support: Literal["map"] | Positive | None = Field(default=None, examples=[5.0])
    outliers: Annotated[float, Field(gt=0, lt=1)] | None = Field(default=None, examples=[0.1])
    apart: Positive | None = Field(default=None, examples=[1.0])
    regions: Literal["along_drives"] | None = None
    best: Count | None = Field(default=None, examples=[5])
    adapts: bool = False
    odds: Annotated[float, Field(gt=1)] | None = Field(default=None, examples=[20.0])
    metric: Literal["proposal", "likelihood", "both"] | None = None

    @model_validator(mode="after")
    def _for_one_that_learns(self) -> Self:
        if self.odds is not None and not self.adapts:
            raise ValueError(f"filter.odds={self.odds:g} is of a filter that adapts: filter.adapts=true")
        if self.adapts and self.best is not None:
            raise ValueError(f"filter.adapts=true: filter.best={self.best} averages poses without a filter")
        if self.metric is not None and self.best is not None:
            raise ValueError(f"filter.metric={self.metric}: filter.best={self.best} averages poses without a filter")
        return self


class LocalizationTask(TaskNode):
    """Localization in a map of images at known poses."""

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


class LocalizationConfig(DescribingConfig):
    """The config of a run of localization."""

    task: LocalizationTask
    descriptor: Choice[Descriptor]
    kernel: PoseKernel
    observation: Choice[Observation]
    likelihood: Likelihood
    motion: Choice[Motion]
    filter: ParticleFilter
    recovery: Choice[Recovery]
    fault: Choice[Fault]
    faults: FaultSuite | None = None
    pooling: Choice[Pooling] | None = None
    local: Choice[LocalFeatureSettings] | None = None


CONFIG = LocalizationConfig
