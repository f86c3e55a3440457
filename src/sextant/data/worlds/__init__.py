"""Datasets rendered from procedural worlds: no download, exact labels."""

from sextant.data.worlds.geojson import TownMap, load_geojson
from sextant.data.worlds.office_walk import OfficeWalk
from sextant.data.worlds.town_factors import TownFactors
from sextant.data.worlds.towns import TownCity, TownPanoramas, TownSeasons

__all__ = ["OfficeWalk", "TownCity", "TownFactors", "TownMap", "TownPanoramas", "TownSeasons", "load_geojson"]
