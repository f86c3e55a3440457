"""Datasets of panoramas."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import CHOSEN_BY_TARGET, Node, Part, Seed
from sextant.config.schema.splits import BlockSide, BySplit, Conditions, ImageSide, Samples, Streets
from sextant.config.schema.world_datasets import require_one_seed


class Panoramas(Part):
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

    target: Literal["sextant.data.calibration.PanoramaFolder"] = Field(alias="_target_")
    partial: bool = Field(alias="_partial_", default=False)
    folder: str = Field(examples=["/path/to/panoramas"])
    height: ImageSide = Field(examples=[512])
    fractions: ShareBySplit
    seed: Seed = Field(examples=[0])
    groups: str | None = Field(examples=["'^[^_]+'"])
    together: list[str] = Field(examples=["[house_a,house_b]"])


class PanoramaMix(Panoramas):
    """Several sources of panoramas."""

    target: Literal["sextant.data.calibration.PanoramaMix"] = Field(alias="_target_")
    sources: dict[
        str,
        Annotated[TownPanoramas | PanoramaFolder, CHOSEN_BY_TARGET],
    ] = Field(min_length=1)
    repeats: dict[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict, examples=["{real: 2}"])
