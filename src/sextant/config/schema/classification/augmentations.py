"""Augmentations of training images."""

from typing import Literal

from pydantic import Field

from sextant.config.schema.parts import Part, Positive


class Augmentation(Part):
    """An augmentation of training images."""


class NoAugmentation(Augmentation):
    """Unchanged training images."""

    target: Literal["sextant.data.augmentation.NoAugmentation"] = Field(alias="_target_")


class PadCropFlip(Augmentation):
    """Random shifts and mirror images."""

    target: Literal["sextant.data.augmentation.PadCropFlip"] = Field(alias="_target_")
    pad: int = Field(ge=0, le=64, examples=[4])
    mode: Literal["reflect", "replicate", "constant"]
    flip: bool


class AugMix(Augmentation):
    """AugMix."""

    target: Literal["sextant.data.augmentation.AugMix"] = Field(alias="_target_")
    severity: int = Field(ge=1, le=10, examples=[3])
    width: int = Field(ge=1, le=16, examples=[3])
    depth: int = Field(ge=-1, le=16, examples=[-1])
    alpha: Positive = Field(examples=[1.0])
    pad: int = Field(ge=0, le=64, examples=[4])
    flip: bool
