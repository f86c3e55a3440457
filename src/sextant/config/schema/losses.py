"""The losses of all tasks that have a choice of them."""

from typing import Annotated

from pydantic import Tag

from sextant.config.schema.cameras import BearingLoss, ParameterLoss
from sextant.config.schema.parts import CustomPart, choose_part
from sextant.config.schema.places import (
    PLACE_LOSSES,
    ContrastiveLoss,
    InfoNCELoss,
    MultiSimilarityLoss,
    SoftMarginLoss,
    TripletMarginLoss,
    TripletRatioLoss,
)

Loss = Annotated[
    Annotated[ParameterLoss, Tag("sextant.losses.ParameterLoss")]
    | Annotated[BearingLoss, Tag("sextant.losses.BearingLoss")]
    | Annotated[TripletRatioLoss, Tag("sextant.losses.TripletRatioLoss")]
    | Annotated[TripletMarginLoss, Tag("sextant.losses.TripletMarginLoss")]
    | Annotated[SoftMarginLoss, Tag("sextant.losses.SoftMarginLoss")]
    | Annotated[ContrastiveLoss, Tag("sextant.losses.ContrastiveLoss")]
    | Annotated[InfoNCELoss, Tag("sextant.losses.InfoNCELoss")]
    | Annotated[MultiSimilarityLoss, Tag("sextant.losses.MultiSimilarityLoss")]
    | Annotated[CustomPart, Tag("custom")],
    choose_part(ParameterLoss, BearingLoss, *PLACE_LOSSES),
]
