"""The choice of a dataset."""

from typing import Annotated

from sextant.config.schema.calibration.datasets import PanoramaFolder, PanoramaMix, TownPanoramas
from sextant.config.schema.classification.datasets import CIFAR10, MNIST, Digits, FashionMNIST, ImageFolder
from sextant.config.schema.localization.datasets import PoseFolder
from sextant.config.schema.parts import CHOSEN_BY_TARGET, CustomPart
from sextant.config.schema.places.datasets import Nordland, PlaceFolders
from sextant.config.schema.world_datasets import OfficeWalk, TownCity, TownFactors, TownSeasons

Dataset = Annotated[
    Digits
    | MNIST
    | FashionMNIST
    | CIFAR10
    | ImageFolder
    | TownPanoramas
    | PanoramaFolder
    | PanoramaMix
    | TownSeasons
    | TownFactors
    | TownCity
    | OfficeWalk
    | Nordland
    | PlaceFolders
    | PoseFolder
    | CustomPart,
    CHOSEN_BY_TARGET,
]
