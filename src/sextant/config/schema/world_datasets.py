"""Rendered worlds."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.images import Dataset
from sextant.config.schema.parts import Node
from sextant.config.schema.splits import BlockSide, BySplit, Conditions, FileBySplit, Samples, Streets
from sextant.ranges import Count, ImageSide, NonNegative, Positive, Seed


def require_one_seed(seed: int, world: int | None) -> None:
    """Raise a ``ValueError`` if a dataset has both the number of a world and the seed of another."""
    if world is not None and seed not in (0, world):
        raise ValueError(f"dataset.world={world} and dataset.seed={seed} name two worlds; leave dataset.seed out")


class World(Dataset):
    """A dataset of images of a rendered world.

    Attributes:
        world: number of the world: the seed of its layout, its textures and the drives through it; None for ``seed``.
        fit_world: the world in which task=localization fits descriptor, kernel, noise and tempering, so that the tested
            world contributes only its map; None fits in the map and the validation drives of the tested world.
    """

    later: ClassVar[tuple[str, ...]] = ("world", "fit_world")
    seed: Seed = Field(examples=[0])
    world: Seed | None = Field(None, examples=[3])
    fit_world: Seed | None = Field(None, examples=[0])

    @model_validator(mode="after")
    def _two_worlds(self) -> Self:
        require_one_seed(self.seed, self.world)
        tested = self.seed if self.world is None else self.world
        if self.fit_world == tested:
            raise ValueError(
                f"dataset.fit_world={self.fit_world} is the tested world; name another, or leave it out to fit in "
                "its validation drives"
            )
        return self


class _Drives(World):
    """Drives through a town with a camera."""

    later = ("streets", *World.later)
    frames: BySplit
    step_m: Annotated[float, Field(ge=0.1, le=50)] = Field(examples=[3.0])
    lateral_sigma_m: Annotated[float, Field(ge=0, le=4)] = Field(examples=[0.3])
    heading_sigma_deg: Annotated[float, Field(ge=0, le=20)] = Field(examples=[2.0])
    width: ImageSide = Field(examples=[96])
    height: ImageSide = Field(examples=[64])
    vfov_deg: Annotated[float, Field(ge=10, le=120)] = Field(examples=[55.0])
    samples: Samples = Field(examples=[4])
    streets: Streets = None


class TownSeasons(_Drives):
    """The same streets under several conditions."""

    target: Literal["sextant.data.worlds.TownSeasons"] = Field(alias="_target_")
    conditions: Conditions
    block_m: BlockSide = Field(examples=[90.0])
    trajectories: FileBySplit


class TestedPlaces(Node):
    """Numbers of places of the training town and of the test town."""

    train: Count = Field(examples=[300])
    test: Count = Field(examples=[100])


class TownFactors(_Drives):
    """One drive under appearances that differ in a single factor."""

    target: Literal["sextant.data.worlds.TownFactors"] = Field(alias="_target_")
    places: TestedPlaces
    base: str = Field(examples=["summer_noon"])
    factors: dict[str, Annotated[list[float], Field(min_length=1)]] = Field(
        min_length=1, examples=["{fog_per_m: [0.01,0.04]}"]
    )
    only: list[str] | None = Field(min_length=1, examples=["[fog_per_m,snow]"])
    block_m: BlockSide = Field(examples=[90.0])
    trajectories: FileBySplit


class TownCity(World):
    """Images in all directions along all streets of a city."""

    later = ("streets", *World.later)
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
    streets: str | None = Field(None, examples=["mytown.geojson"])


class Laser(Node):
    """A laser scanner."""

    beams: Annotated[int, Field(ge=1, le=10000)] = Field(examples=[180])
    field_of_view_rad: Annotated[float, Field(gt=0, le=6.2832)] = Field(examples=[3.1415])
    max_range_m: Positive = Field(examples=[15.0])
    range_sigma_m: NonNegative = Field(examples=[0.02])
    dropout: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.01])


class OfficeWalk(World):
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
