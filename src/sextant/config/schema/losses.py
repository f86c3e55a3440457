"""The losses of all tasks that have a choice of them."""

from typing import Annotated

from sextant.config.schema.calibration.cameras import BearingLoss, ParameterLoss
from sextant.config.schema.parts import CHOSEN_BY_TARGET, CustomPart
from sextant.config.schema.places.parts import (
    ContrastiveLoss,
    InfoNCELoss,
    MultiSimilarityLoss,
    SoftMarginLoss,
    TripletMarginLoss,
    TripletRatioLoss,
)

Loss = Annotated[
    ParameterLoss
    | BearingLoss
    | TripletRatioLoss
    | TripletMarginLoss
    | SoftMarginLoss
    | ContrastiveLoss
    | InfoNCELoss
    | MultiSimilarityLoss
    | CustomPart,
    CHOSEN_BY_TARGET,
]
