"""Pictures of the worlds for people to look at: streets, seasons, panoramas, an office, a map."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import shapely
import torch
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from sextant.data.worlds.shots import camera_poses
from sextant.data.worlds.towns import perspective, street_poses
from sextant.figures.street_map import street_map
from sextant.figures.style import save_figure
from sextant.geometry import EquirectangularCamera, PerspectiveCamera
from sextant.worlds.appearance import CONDITIONS, condition
from sextant.worlds.buildings import footprints
from sextant.worlds.office import Office
from sextant.worlds.office_layouts import procedural_plan
from sextant.worlds.office_routes import wander
from sextant.worlds.renderer import Rays
from sextant.worlds.routes import drive, walk
from sextant.worlds.street_layouts import grid_streets, irregular_streets
from sextant.worlds.tours import random_walk
from sextant.worlds.town import Town


@dataclass(frozen=True)
class Spot:
    """Where a street picture is taken, and when.

    Attributes:
        town: which of the gallery's towns.
        condition: named appearance, with ``factors`` set otherwise.
        metres: along the walk or drive of that town.
        turn_deg: of the camera, counter-clockwise from the way ahead; ``tilt_deg`` up.
        on_foot: from the pavement instead of the lane.
        height_m: of the camera.
    """

    town: str
    condition: str
    metres: float
    turn_deg: float = 0.0
    tilt_deg: float = 3.0
    on_foot: bool = False
    height_m: float = 1.6
    factors: tuple[tuple[str, float], ...] = ()


STREETS = (
    Spot("centre", "summer_noon", 416, factors=(("traffic_per_100m", 2.0),)),
    Spot("centre", "night_rain", 350, factors=(("traffic_per_100m", 2.0),)),
    Spot("old_town", "summer_evening", 152, factors=(("traffic_per_100m", 2.0),)),
    Spot("suburb", "autumn_morning", 60, on_foot=True),
    Spot("suburb", "winter_noon", 449),
    Spot("old_town", "winter_dusk", 515, factors=(("traffic_per_100m", 2.0),)),
    Spot("old_town", "autumn_rain", 383, factors=(("traffic_per_100m", 3.0),)),
    Spot("suburb", "summer_noon", 350),
    Spot("centre", "fog", 340, on_foot=True, factors=(("fog_per_m", 0.02),)),
    Spot("centre", "night_clear", 60, on_foot=True, factors=(("traffic_per_100m", 3.0),)),
)


@cache
def _town(name: str) -> Town:
    if name == "centre":
        return Town(grid_streets(4, 4, 95.0, seed=5, jitter_m=6.0), 11, density=0.95)
    if name == "old_town":
        return Town(irregular_streets(420.0, 78.0, 12), 12, density=0.75)
    return Town(irregular_streets(460.0, 95.0, 13), 13, density=0.3)


def street_picture(spot: Spot, camera: PerspectiveCamera, samples: int) -> UInt8[ndarray, "h w 3"]:
    """One picture with soft shade."""
    town = _town(spot.town)
    nodes = random_walk(town.graph, 900, seed=1)
    route = (walk if spot.on_foot else drive)(town.graph, nodes, seed=2).sample_by_distance(1.0)
    x, y, heading = route.poses[int(spot.metres)]
    pose = np.array([[x, y, spot.height_m, heading + np.radians(spot.turn_deg), np.radians(spot.tilt_deg), 0.0]])
    look = condition(spot.condition, **dict(spot.factors))
    renderer = town.renderer(look, clear_of=pose[:, :2], soft=True)
    return np.asarray(renderer.pictures(Rays.of_camera(camera, samples), camera_poses(pose), look)[0])


def sheet(pictures: Sequence[UInt8[ndarray, "h w 3"]], names: Sequence[str], columns: int) -> Image.Image:
    """Pictures of one size side by side, with their names in the corner."""
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    gap = 4
    page = Image.new("RGB", (columns * (width + gap) - gap, rows * (height + gap) - gap), "white")
    pen = ImageDraw.Draw(page)
    font = ImageFont.load_default(size=max(12, height // 18))
    for i, (picture, name) in enumerate(zip(pictures, names, strict=True)):
        corner = (i % columns * (width + gap), i // columns * (height + gap))
        page.paste(Image.fromarray(picture), corner)
        pen.text((corner[0] + 8, corner[1] + 5), name, fill="white", stroke_width=2, stroke_fill="black", font=font)
    return page


def _streets(folder: Path, samples: int) -> list[Path]:
    camera = perspective(960, 540, 58.0)
    paths = []
    for i, spot in enumerate(STREETS, start=1):
        picture = Image.fromarray(street_picture(spot, camera, samples))
        paths.append(_save(picture, folder / f"street_{i:02d}_{spot.town}_{spot.condition}.png"))
    return paths


def _conditions(folder: Path, samples: int) -> list[Path]:
    spot = Spot("centre", "summer_noon", 416)
    pictures = [
        street_picture(Spot(spot.town, name, spot.metres), perspective(480, 300, 58.0), samples) for name in CONDITIONS
    ]
    return [_save(sheet(pictures, [name.replace("_", " ") for name in CONDITIONS], 2), folder / "conditions.png")]


def _panoramas(folder: Path, samples: int) -> list[Path]:
    rays = Rays.of_camera(EquirectangularCamera(960, 480), samples)
    pictures, names = [], []
    for k, (name, look) in enumerate(
        (
            ("centre", "summer_noon"),
            ("old_town", "autumn_morning"),
            ("suburb", "summer_evening"),
            ("suburb", "winter_noon"),
        )
    ):
        town = _town(name)
        pose = camera_poses(street_poses(town.graph, 1, np.random.default_rng(20 + k)))
        pictures.append(town.renderer(condition(look), soft=True).pictures(rays, pose, condition(look))[0])
        names.append(f"{name}, {look}".replace("_", " "))
    return [_save(sheet(pictures, names, 2), folder / "panoramas.png")]


def _from_above(folder: Path, samples: int) -> list[Path]:
    town = _town("old_town")
    left, bottom, right, top = town.graph.bounds
    pose = np.array([[(left + right) / 2 - 30, bottom - 40, 85.0, np.radians(82), np.radians(-26), 0.0]])
    look = condition("summer_evening", sun_elevation_deg=24.0)
    camera = PerspectiveCamera.from_vfov(torch.tensor(0.8, dtype=torch.float64), 1280, 720)
    picture = town.renderer(look, soft=True).pictures(Rays.of_camera(camera, samples), camera_poses(pose), look)[0]
    lots = [np.asarray(lot.exterior.coords) for lot in town.ground.lots[:-1] if not lot.is_empty]
    nodes = random_walk(town.graph, 1500, seed=1)
    routes = {
        "a drive": drive(town.graph, nodes, seed=2).poses[:, :2],
        "a walk": walk(town.graph, random_walk(town.graph, 700, seed=5), seed=3).poses[:, :2],
    }
    box = shapely.box(left - 30, bottom - 30, right + 30, top + 30)
    trees = town.trees.position[shapely.contains_xy(box, *town.trees.position[:, :2].T)][:, :2]
    figure = street_map(lots, footprints(town.buildings), trees, routes, box.bounds)
    return [_save(Image.fromarray(picture), folder / "from_above.png"), *save_figure(figure, folder, "map")]


def _office(folder: Path, samples: int) -> list[Path]:
    plan = procedural_plan((46.0, 16.0), 0)
    drive_ = wander(plan, 120.0, 0.1, np.random.default_rng(3))
    office = Office(replace(plan, tracks=(plan.to_plan(drive_[:, :2]),)), 0)
    rays = Rays.of_camera(perspective(640, 400, 62.0), samples)
    pictures, names = [], []
    for metres, look in (
        (4, "summer_noon"),
        (22, "summer_noon"),
        (45, "night_clear"),
        (60, "summer_noon"),
        (78, "summer_noon"),
        (100, "night_clear"),
    ):
        x, y, heading = drive_[10 * metres]
        pose = camera_poses(np.array([[x, y, 1.3, heading, 0.0, 0.0]]))
        pictures.append(office.renderer(condition(look)).pictures(rays, pose, condition(look))[0])
        names.append(f"{metres} m, {look}".replace("_", " "))
    return [_save(sheet(pictures, names, 2), folder / "office.png")]


def _save(image: Image.Image, path: Path) -> Path:
    """In 256 dithered colours: a third of the size, and no artefacts that were not rendered."""
    image.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    return path


#: what the gallery consists of
SECTIONS: dict[str, Callable[[Path, int], list[Path]]] = {
    "streets": _streets,
    "conditions": _conditions,
    "panoramas": _panoramas,
    "from_above": _from_above,
    "office": _office,
}


def render_gallery(folder: Path, samples: int, sections: Sequence[str], done: Callable[[list[Path]], None]) -> None:
    """Write the pictures of some sections into ``folder``, telling of each section's files as they are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for section in sections:
        done(SECTIONS[section](folder, samples))
