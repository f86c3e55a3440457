"""The choice of a dataset."""

from typing import Annotated

from pydantic import Tag

from sextant.config.schema.image_datasets import CIFAR10, MNIST, Digits, FashionMNIST, ImageFolder
from sextant.config.schema.localization_datasets import PoseFolder
from sextant.config.schema.panorama_datasets import PanoramaFolder, PanoramaMix, TownPanoramas
from sextant.config.schema.parts import CustomPart, choose_part
from sextant.config.schema.place_datasets import Nordland, PlaceFolders
from sextant.config.schema.world_datasets import OfficeWalk, TownCity, TownFactors, TownSeasons

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
    | Annotated[TownFactors, Tag("sextant.data.worlds.TownFactors")]
    | Annotated[TownCity, Tag("sextant.data.worlds.TownCity")]
    | Annotated[OfficeWalk, Tag("sextant.data.worlds.OfficeWalk")]
    | Annotated[Nordland, Tag("sextant.data.places.Nordland")]
    | Annotated[PlaceFolders, Tag("sextant.data.places.PlaceFolders")]
    | Annotated[PoseFolder, Tag("sextant.data.localization.PoseFolder")]
    | Annotated[CustomPart, Tag("custom")],
    choose_part(
        Digits,
        MNIST,
        FashionMNIST,
        CIFAR10,
        ImageFolder,
        TownPanoramas,
        PanoramaFolder,
        PanoramaMix,
        TownSeasons,
        TownFactors,
        TownCity,
        OfficeWalk,
        Nordland,
        PlaceFolders,
        PoseFolder,
    ),
]
