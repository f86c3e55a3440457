"""Worlds: a procedural town and an office, rendered by ray casting for any camera, light and season."""

from sextant.worlds.appearance import CONDITIONS, Appearance, condition
from sextant.worlds.footprints import Footprint
from sextant.worlds.given_streets import given_streets
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.occupancy import OccupancyGrid, occupancy_from_scans
from sextant.worlds.office import Office
from sextant.worlds.office_carving import plan_along
from sextant.worlds.office_layouts import procedural_plan
from sextant.worlds.renderer import Motion, Rays, Renderer, View
from sextant.worlds.routes import Route, drive, walk
from sextant.worlds.scene import Scene
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.tours import coverage_tour, random_walk
from sextant.worlds.town import Town
from sextant.worlds.traced_streets import traced_streets
from sextant.worlds.trajectories import load_cold, load_kitti_poses

__all__ = [
    "CONDITIONS",
    "Appearance",
    "Footprint",
    "LaserScanner",
    "Motion",
    "OccupancyGrid",
    "Office",
    "Rays",
    "Renderer",
    "Route",
    "Scene",
    "StreetGraph",
    "Town",
    "View",
    "condition",
    "coverage_tour",
    "drive",
    "given_streets",
    "grid_streets",
    "irregular_streets",
    "load_cold",
    "load_kitti_poses",
    "occupancy_from_scans",
    "plan_along",
    "procedural_plan",
    "random_walk",
    "scan",
    "traced_streets",
    "walk",
]
