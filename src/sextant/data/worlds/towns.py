"""Datasets of towns: panoramas, the same streets under seasons, and a whole city."""

import hashlib
import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.worlds.geojson import load_geojson
from sextant.data.worlds.shots import SPLITS, Shots, WorldPlan
from sextant.errors import ArgumentError
from sextant.geometry import Camera, EquirectangularCamera, PerspectiveCamera
from sextant.worlds.appearance import Appearance
from sextant.worlds.renderer import Renderer
from sextant.worlds.routes import DRIVER, Gait, drive
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import irregular_streets
from sextant.worlds.tours import random_walk
from sextant.worlds.town import Town
from sextant.worlds.traced_streets import traced_streets
from sextant.worlds.trajectories import load_kitti_poses, plane_positions

CAMERA_HEIGHT_M = 1.6


def perspective(width: int, height: int, vfov_deg: float) -> PerspectiveCamera:
    """A pinhole camera."""
    return PerspectiveCamera.from_vfov(torch.tensor(math.radians(vfov_deg), dtype=torch.float64), width, height)


class _TownPlan(WorldPlan):
    """Towns, one a scene, each with its own streets and its own seed for everything along them."""

    detail = "fine"

    @abstractmethod
    def invented(self, scene: int) -> StreetGraph:
        """The streets of a town of which there is no map."""

    def map_file(self, scene: int) -> str | None:
        """The GeoJSON file that says what stands in a town, if there is one."""
        return streets_of(self.config, self.split_of(scene))

    def split_of(self, scene: int) -> str:
        """The split that a town is in."""
        return SPLITS[scene]

    def graph(self, scene: int) -> StreetGraph:
        """The streets of a town."""
        file = self.map_file(scene)
        return load_geojson(file).streets if file else self.invented(scene)

    def town(self, scene: int) -> Town:
        """A town; no two scenes share a seed."""
        cameras = self.shots.pose[self.shots.scene == scene, :2]
        file = self.map_file(scene)
        return Town(
            self.graph(scene),
            town_seed(self.config["seed"], scene),
            detail=self.detail,
            density=self.density(scene),
            keep_clear=cameras,
            footprints=load_geojson(file).footprints if file else None,
        )

    def size_facts(self, scenes: Iterable[int]) -> dict[str, Any]:
        """How large the towns are, and what was read of the maps of some."""
        scenes = list(scenes)
        graphs = [self.graph(scene) for scene in scenes]
        facts: dict[str, Any] = {
            "street_kilometres": round(sum(graph.length_m for graph in graphs) / 1000, 3),
            "square_kilometres": round(sum(graph.area_km2 for graph in graphs), 3),
        }
        files = sorted({file for scene in scenes if (file := self.map_file(scene))})
        return facts | ({"maps": {file: load_geojson(file).facts for file in files}} if files else {})

    def density(self, scene: int) -> float:
        """How built-up a town is."""
        return float(np.random.default_rng([self.config["seed"], 77, scene]).uniform(0.35, 0.95))

    def build(self, scene: int, appearance: Appearance) -> Renderer:
        """A renderer of one town under an appearance."""
        cameras = self.shots.pose[self.shots.scene == scene, :2]
        return self.town(scene).renderer(appearance, clear_of=cameras)


def town_seed(seed: int, scene: int) -> int:
    """The seed of one town: scenes of one dataset have different ones, and so have datasets of different ``seed``.

    Two kinds of dataset with the same ``seed`` share texture seeds, but not streets or splits.
    """
    return seed * 1000 + scene


#: a town is built again for each of its conditions (foliage and cars differ), which takes as long as six panoramas
CONDITIONS_PER_TOWN = 2


class TownPanoramasPlan(_TownPlan):
    """Upright panoramas on streets and pavements of many towns; see :class:`TownPanoramas`."""

    chunk = 8

    @property
    def camera(self) -> Camera:
        """A full panorama."""
        return EquirectangularCamera(2 * self.config["height"], self.config["height"])

    @cached_property
    def _scenes_of_split(self) -> list[range]:
        towns = np.cumsum([0] + [self.config["towns"][split] for split in SPLITS])
        return [range(a, b) for a, b in pairwise(towns)]

    def split_of(self, scene: int) -> str:
        """The split that a town is in."""
        return next(split for split, scenes in zip(SPLITS, self._scenes_of_split, strict=True) if scene in scenes)

    def invented(self, scene: int) -> StreetGraph:
        """Streets of a small town."""
        return irregular_streets(self.config["size_m"], self.config["block_m"], town_seed(self.config["seed"], scene))

    def lay_out(self) -> Shots:
        """Panoramas ordered by town and condition, so that one scene serves many in a row."""
        parts = []
        place = 0
        for split, scenes in enumerate(self._scenes_of_split):
            wanted = self.config["images"][SPLITS[split]]
            for k, scene in enumerate(scenes):
                n = wanted * (k + 1) // len(scenes) - wanted * k // len(scenes)
                rng = np.random.default_rng([self.config["seed"], 78, scene])
                own = (scene * CONDITIONS_PER_TOWN + np.arange(CONDITIONS_PER_TOWN)) % len(self.appearances)
                condition = np.sort(own[rng.permutation(n) % CONDITIONS_PER_TOWN])
                pose = street_poses(self.graph(scene), n, rng)
                parts.append(Shots.of(
                    scene, condition, split, place + np.arange(n), pose,
                    sun_turn_deg=rng.uniform(-180, 180, n), exposure_ev=rng.normal(0, 0.25, n),
                ))  # fmt: skip
                place += n
        return Shots.join(parts)

    def describe(self) -> dict[str, Any]:
        """Towns and their size."""
        return self.size_facts(range(self._scenes_of_split[-1].stop)) | {"towns": self.config["towns"]}


class TownSeasonsPlan(_TownPlan):
    """Drives through the same streets under several conditions; see :class:`TownSeasons`."""

    chunk = 64

    @property
    def camera(self) -> Camera:
        """A camera on the car, looking ahead."""
        return perspective(self.config["width"], self.config["height"], self.config["vfov_deg"])

    @property
    def gait(self) -> Gait:
        """How the car wanders about its lane."""
        wander = {
            "lateral_sigma_m": self.config["lateral_sigma_m"],
            "heading_sigma_rad": math.radians(self.config["heading_sigma_deg"]),
        }
        return replace(DRIVER, **wander)

    def invented(self, scene: int) -> StreetGraph:
        """Streets enough for the frames of the split, or those of a real trajectory."""
        trajectory = self.config["trajectories"][SPLITS[scene]]
        if trajectory:
            driven = plane_positions(load_kitti_poses(trajectory))
            return traced_streets(driven, seed=town_seed(self.config["seed"], scene))
        block = self.config["block_m"]
        length = 2.5 * self.config["frames"][SPLITS[scene]] * self.config["step_m"]
        return irregular_streets(
            max(4 * block, math.sqrt(length * block / 2) + block), block, town_seed(self.config["seed"], scene)
        )

    def lay_out(self) -> Shots:
        """Frame ``i`` of every traverse of a split is the same place, driven with another seed."""
        parts = []
        for split, name in enumerate(SPLITS):
            for k in range(len(self.appearances)):
                pose, velocity = self.traverse(split, k)
                n = self.config["frames"][name]
                parts.append(Shots.of(split, k, split, np.arange(n), pose, velocity=velocity))
        return Shots.join(parts)

    def traverse(self, split: int, drive_number: int) -> tuple[Float64[ndarray, "n 6"], Float64[ndarray, "n 4"]]:
        """Pose and velocity at every frame of one of the drives along the route of a split."""
        n, step = self.config["frames"][SPLITS[split]], self.config["step_m"]
        graph, seed = self.graph(split), town_seed(self.config["seed"], split)
        nodes = random_walk(graph, 1.25 * n * step + 300, seed)  # corners are cut: the drive is shorter
        route = drive(graph, nodes, seed=seed * 100 + drive_number, gait=self.gait)
        still = np.gradient(route.arc_m, route.times) if len(route.times) > 1 else np.zeros(1)
        sampled = route.sample_by_distance(step)
        speed = np.interp(sampled.times, route.times, still)[:n]
        x, y, heading = sampled.poses[:n].T
        zero = np.zeros(len(x))
        pose = np.column_stack([x, y, zero + CAMERA_HEIGHT_M, heading, zero, zero])
        return pose, np.column_stack([speed * np.cos(heading), speed * np.sin(heading), zero, zero])

    def describe(self) -> dict[str, Any]:
        """Towns and the length of a traverse."""
        frames = self.config["frames"]
        return self.size_facts(range(3)) | {
            "traverse_kilometres": {name: round(frames[name] * self.config["step_m"] / 1000, 3) for name in SPLITS}
        }


class TownCityPlan(_TownPlan):
    """A city seen in all directions from all along its streets, and drives through it; see :class:`TownCity`."""

    chunk = 512
    detail = "coarse"

    @property
    def camera(self) -> Camera:
        """One view of many at a position."""
        return perspective(self.config["width"], self.config["height"], self.config["vfov_deg"])

    @property
    def splits(self) -> tuple[str, ...]:
        """The map, and the queries to find in it."""
        return ("map", "query")

    def density(self, scene: int) -> float:
        """Built-up in the middle, gardens at the rim."""
        return 0.8

    def invented(self, scene: int) -> StreetGraph:
        """The streets of the city."""
        return irregular_streets(self.config["size_m"], self.config["block_m"], town_seed(self.config["seed"], 0))

    @cached_property
    def _graph(self) -> StreetGraph:
        return super().graph(0)

    def graph(self, scene: int) -> StreetGraph:
        """The streets of the city."""
        return self._graph

    def lay_out(self) -> Shots:
        """Map views position by position along each street, then query drives."""
        headings, images = self.config["headings"], self.config["images"]
        positions = math.ceil(images / headings)
        along = _along_streets(self._graph, positions)
        turn = 2 * np.pi * np.arange(headings) / headings
        x, y, street = (np.repeat(column, headings)[:images] for column in along.T)
        heading = (street + np.tile(turn, positions)[:images] + np.pi) % (2 * np.pi) - np.pi
        zero = np.zeros(images)
        pose = np.column_stack([x, y, zero + CAMERA_HEIGHT_M, heading, zero, zero])
        parts = [Shots.of(0, 0, 0, np.repeat(np.arange(positions), headings)[:images], pose)]
        frames, step = self.config["query_frames"], self.config["query_step_m"]
        for k in range(len(self.appearances) if frames else 0):
            seed = town_seed(self.config["seed"], 500 + k)
            nodes = random_walk(self._graph, 1.25 * frames * step + 300, seed)
            route = drive(self._graph, nodes, seed=seed).sample_by_distance(step)
            qx, qy, heading = route.poses[:frames].T
            zero = np.zeros(len(qx))
            pose = np.column_stack([qx, qy, zero + CAMERA_HEIGHT_M, heading, zero, zero])
            parts.append(Shots.of(0, k, 1, -1, pose))
        return Shots.join(parts)

    def describe(self) -> dict[str, Any]:
        """How large the city is."""
        return self.size_facts([0]) | {"positions": math.ceil(self.config["images"] / self.config["headings"])}


def street_poses(graph: StreetGraph, n: int, rng: np.random.Generator) -> Float64[ndarray, "n 6"]:
    """Places to stand with a camera: in a lane or on a pavement, away from walls, trunks and parked cars."""
    edge = rng.choice(len(graph.edges), n, p=graph.lengths / graph.lengths.sum())
    start, end = graph.nodes[graph.edges[edge, 0]], graph.nodes[graph.edges[edge, 1]]
    along = (end - start) / graph.lengths[edge, None]
    side = np.stack([along[:, 1], -along[:, 0]], -1) * np.where(rng.random(n) < 0.5, 1, -1)[:, None]
    half = graph.widths[edge] / 2
    lateral = np.where(rng.random(n) < 0.6, half * rng.uniform(0.0, 0.45, n), half + rng.uniform(1.9, 2.5, n))
    share = rng.uniform(10.0, np.maximum(graph.lengths[edge] - 10.0, 11.0)) / graph.lengths[edge]
    xy = start + along * (share * graph.lengths[edge])[:, None] + side * lateral[:, None]
    zero = np.zeros(n)
    return np.column_stack([xy, rng.uniform(1.35, 1.95, n), rng.uniform(-np.pi, np.pi, n), zero, zero])


def _along_streets(graph: StreetGraph, positions: int) -> Float64[ndarray, "positions 3"]:
    """Positions at even distances along all streets, on the right-hand lane; x, y and the street's heading."""
    ends = np.cumsum(graph.lengths)
    s = (np.arange(positions) + 0.5) * ends[-1] / positions
    edge = np.searchsorted(ends, s)
    start, end = graph.nodes[graph.edges[edge, 0]], graph.nodes[graph.edges[edge, 1]]
    along = (end - start) / graph.lengths[edge, None]
    right = np.stack([along[:, 1], -along[:, 0]], -1)
    offset = s - (ends[edge] - graph.lengths[edge])
    xy = start + along * offset[:, None] + right * graph.widths[edge, None] / 4
    return np.column_stack([xy, np.arctan2(along[:, 1], along[:, 0])])


def file_hashes(paths: Iterable[str | None]) -> dict[str, str]:
    """SHA-256 of the contents of those files that are there."""
    there = [path for path in paths if path and Path(path).expanduser().is_file()]
    return {path: hashlib.sha256(Path(path).expanduser().read_bytes()).hexdigest() for path in there}


def streets_of(config: Mapping[str, Any], split: str) -> str | None:
    """The map of the town of a split: one file is that of every split, which has other houses, trees and drives."""
    streets = config.get("streets")
    return streets.get(split) if isinstance(streets, Mapping) else streets


class RenderedWorld:
    """A dataset that is rendered on this machine when it is first needed.

    Args:
        roots: folders that datasets lie in; stores are kept in the last.
        config: the keys of the dataset's YAML file.
    """

    name: str
    plan_type: type[WorldPlan]

    def __init__(self, *, roots: Sequence[Path], **config: Any):
        self.cache = Path(roots[-1])
        self.config: Mapping[str, Any] = config

    def plan(self) -> WorldPlan:
        """What is rendered, and how."""
        return self.plan_type(self.name, self.identified(), list(self.config["conditions"]), self.config["samples"])

    def identified(self) -> dict[str, Any]:
        """The config with the contents of the files that it names."""
        maps = file_hashes(streets_of(self.config, split) for split in SPLITS)
        return {**self.config, **({"streets_sha256": maps} if maps else {})}


class TownPanoramas(RenderedWorld):
    """Upright 2:1 panoramas in many towns; the towns of a split are in no other split, nor are their seeds,
    but for those of one map.

    Keys: ``images`` and ``towns`` by split, ``height`` in pixels, ``samples`` a pixel, ``conditions``, ``size_m``,
    ``block_m``, ``streets`` (a GeoJSON file, or one by split, that the towns are built from), ``seed``.
    """

    name = "town_panoramas"
    plan_type = TownPanoramasPlan


class TownSeasons(RenderedWorld):
    """Traverses of the same streets under several conditions, with poses; a town for each split, or one map's for all.

    Keys: ``frames`` by split, ``step_m`` between frames, ``lateral_sigma_m`` and ``heading_sigma_deg`` of the car's
    wander, ``width``, ``height``, ``vfov_deg``, ``samples``, ``conditions``,
    ``block_m``, ``trajectories`` (KITTI pose files by split, whose streets are then traced), ``streets`` (a
    GeoJSON file, or one by split, that the town is built from), ``seed``.
    """

    name = "town_seasons"
    plan_type = TownSeasonsPlan

    def identified(self) -> dict[str, Any]:
        """The config with the contents of its maps and trajectories.

        Raises:
            UserError: a split has both.
        """
        trajectories = self.config["trajectories"]
        for split, trajectory in trajectories.items():
            if trajectory and (file := streets_of(self.config, split)):
                raise ArgumentError(
                    f"trajectories.{split}={trajectory} and streets={file} are both given for the {split} town",
                    f"Leave one out: trajectories.{split}=null",
                )
        return {**super().identified(), "trajectory_sha256": file_hashes(trajectories.values())}


class TownCity(RenderedWorld):
    """A city of 8 km2 in 172,000 pictures, ``headings`` at each position, and drives to localize.

    Keys: ``images``, ``headings``, ``size_m``, ``block_m``, ``width``, ``height``, ``vfov_deg``, ``samples``,
    ``conditions`` (the first is the map's), ``query_frames`` a condition, ``query_step_m``, ``streets`` (a GeoJSON file
    that the city is built from), ``seed``.
    """

    name = "town_city"
    plan_type = TownCityPlan
