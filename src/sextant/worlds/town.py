"""A procedural town: what stands where, from a street graph and a seed, and its triangles in an appearance."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from shapely import Polygon

from sextant.errors import UserError
from sextant.worlds import street_objects as objects
from sextant.worlds.appearance import Appearance
from sextant.worlds.blocks import KERB_M, PAVEMENT_M, Ground
from sextant.worlds.buildings import Buildings, building_mesh, design, footprints
from sextant.worlds.footprints import Footprint, houses_on
from sextant.worlds.lamps import Lamps
from sextant.worlds.mesh import Mesh, boxes
from sextant.worlds.placement import Objects, clear_of_cameras
from sextant.worlds.planting import country_trees, garden_trees, street_trees
from sextant.worlds.plots import plots_along
from sextant.worlds.renderer import Renderer
from sextant.worlds.scene import Scene
from sextant.worlds.shading.noise import value_noise
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.surfaces import KIND, Kind, palette, surface_rows
from sextant.worlds.trees import Trees, tree_mesh

#: leaves per tree, and the largest number of trees in the countryside
LEAVES, COUNTRY_TREES = {"fine": 1300, "coarse": 70}, {"fine": 5000, "coarse": 9000}
#: of gardens
HEDGE_GREEN, FENCE_COLOURS = palette("#4d6b2f"), palette("#b9ab8f", "#6b4a32", "#d8d4c8")


class Town:
    """A town that is the same for the same graph and seed.

    Args:
        graph: its streets.
        seed: determines what is built along them.
        detail: ``fine`` for pictures (trees with 1300 leaves), ``coarse`` for whole cities.
        density: how built-up the centre is, from 0 for a village to 1 for a city centre.
        keep_clear: positions (x, y) of cameras: no car, person, trunk, post, hedge or fence is within a step of them.
        footprints: where buildings stand, as :func:`~sextant.worlds.footprints.fit_footprints` returns them; None for
            houses along the streets.
    """

    def __init__(
        self,
        graph: StreetGraph,
        seed: int,
        *,
        detail: str = "fine",
        density: float = 0.75,
        keep_clear: Float64[ndarray, "n 2"] | None = None,
        footprints: Sequence[Footprint] | None = None,
    ):
        if detail not in LEAVES:
            raise UserError(f"detail is {detail!r}; it must be one of {', '.join(LEAVES)}")
        if not 0 <= density <= 1:
            raise UserError(f"density is {density}; it must be from 0 to 1")
        self.graph, self.seed, self.detail, self.density = graph, seed, detail, density
        self.ground, self.footprints = Ground(graph), footprints
        self._cameras = None if keep_clear is None or not len(keep_clear) else cKDTree(keep_clear)

    # -- what stands where ---------------------------------------------------------------------------------------------

    @cached_property
    def districts(self) -> Float64[ndarray, "b"]:
        """How built-up each block is, 0 to 1: smooth noise, higher towards the centre; -1 marks a park."""
        rng = np.random.default_rng([self.seed, 1])
        left, bottom, right, top = self.graph.bounds
        middle_x, middle_y = (left + right) / 2, (bottom + top) / 2
        radius = 0.5 * max(right - left, top - bottom, 200.0)
        values = []
        for block in self.ground.blocks[:-1]:
            x, y = block.centroid.x, block.centroid.y
            noise = value_noise(x / 260.0, y / 260.0, 1000 + self.seed)
            distance = float(np.hypot(x - middle_x, y - middle_y)) / radius
            values.append(np.clip(self.density + 0.75 * (noise - 0.5) - 0.35 * max(distance - 0.35, 0), 0.02, 1))
        town = np.array(values)
        park = (rng.random(len(town)) < 0.07) & np.array([1500 < b.area < 40000 for b in self.ground.blocks[:-1]], bool)
        return np.append(np.where(park, -1.0, town), 0.55 * self.density)

    @cached_property
    def _built(self) -> tuple[Buildings, dict[int, Polygon]]:
        """All buildings, and the outlines of those that are no rectangles, by their number."""
        rng = np.random.default_rng([self.seed, 2])
        if self.footprints is not None:
            return houses_on(self.footprints, self.ground, self.density, rng)
        found = [
            lot
            for block, density in enumerate(self.districts)
            if density >= 0
            for lot in plots_along(self.ground, block, float(density), rng)
        ]
        if not found:
            raise UserError("no building fits between the streets", "Use larger blocks, say block_m=80.")
        table = np.array(found)
        position = np.column_stack([table[:, :2], np.full(len(table), KERB_M)])
        attached = table[:, 7:9] > 0
        return design(position, table[:, 2], table[:, 3:5], table[:, 5], attached, table[:, 6] > 0, rng), {}

    @property
    def buildings(self) -> Buildings:
        """Houses along the lot lines of every block, or on the footprints given."""
        return self._built[0]

    @cached_property
    def outlines(self) -> list[Polygon]:
        """The footprint of each building."""
        buildings, shapes = self._built
        boxes = shapely.polygons(footprints(buildings).astype(np.float64)).tolist()
        return [shapes.get(i, box) for i, box in enumerate(boxes)]

    @cached_property
    def _footprints(self) -> shapely.STRtree:
        return shapely.STRtree(self.outlines)

    def _clear(self, points: Float64[ndarray, "n 2"], metres: float) -> Bool[ndarray, "n"]:
        """Which points keep a distance from every house."""
        if not len(points):
            return np.zeros(0, bool)
        near = self._footprints.query(shapely.points(points), predicate="dwithin", distance=metres)[0]
        clear = np.ones(len(points), bool)
        clear[near] = False
        return clear

    def _apart(
        self,
        points: Float64[ndarray, "n 2"],
        metres: float,
        heading: Float64[ndarray, "n"] | None = None,
        reach: Float64[ndarray, "n"] | float = 0.0,
    ) -> Bool[ndarray, "n"]:
        """Which objects keep a distance from every camera; long ones extend both ways along ``heading``."""
        apart = np.ones(len(points), bool)
        if self._cameras is None or not len(points):
            return apart
        if heading is None:
            return np.asarray(self._cameras.query(points)[0] > metres)
        along = np.stack([np.cos(heading), np.sin(heading)], -1) * np.reshape(reach, (-1, 1))
        for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
            apart &= self._cameras.query(points + share * along)[0] > metres
        return apart

    @cached_property
    def trees(self) -> Trees:
        """Trees along pavements, in gardens and parks, and in the countryside."""
        rng = np.random.default_rng([self.seed, 3])
        rows = []
        for block, density in enumerate(self.districts):
            rows += street_trees(self.ground, block, rng)
            if block < len(self.districts) - 1:
                rows += garden_trees(self.ground.lots[block], float(density), rng)
        rows += country_trees(self.ground, self.seed, COUNTRY_TREES[self.detail], rng)
        table = np.array(rows).reshape(-1, 4)
        keep = self._clear(table[:, :2], 1.6)
        street = shapely.contains_xy(self.ground.roads, table[:, 0], table[:, 1])
        table = table[keep & ~street & self._apart(table[:, :2], 1.6)]
        n = len(table)
        position = np.column_stack([table[:, :2], np.full(n, KERB_M)])
        return Trees(position, rng.uniform(0, 2 * np.pi, n), table[:, 2], table[:, 3] > 0, rng.random(n))

    @cached_property
    def lamps(self) -> Objects:
        """Street lamps by the kerb, with arms over the road."""
        rng = np.random.default_rng([self.seed, 4])
        lamps = Objects.of([
            (*side.at(s, 0.0), KERB_M, side.heading - np.pi / 2, rng.random())
            for block in range(len(self.ground.blocks))
            for side in self.ground.sides(block, inset=-PAVEMENT_M + 1.1, shortest_m=10)
            for s in np.arange(8 + 20 * (block % 2), side.length - 2, 32.0)
        ])  # fmt: skip
        return lamps.where(self._apart(lamps.position[:, :2], 0.6))

    @cached_property
    def signs(self) -> Objects:
        """Traffic signs near corners, facing traffic that drives on the right."""
        rng = np.random.default_rng([self.seed, 5])
        signs = Objects.of([
            (*side.at(side.length - rng.uniform(4, 8), 0.0), KERB_M, side.heading + np.pi, rng.random())
            for block in range(len(self.ground.blocks))
            for side in self.ground.sides(block, inset=-PAVEMENT_M + 1.1, shortest_m=18)
            if rng.random() < 0.55
        ])  # fmt: skip
        return signs.where(self._apart(signs.position[:, :2], 0.9))

    @cached_property
    def benches(self) -> Objects:
        """Benches on pavements and along the edges of parks."""
        rng = np.random.default_rng([self.seed, 6])
        return Objects.of([
            (*side.at(rng.uniform(4, side.length - 4), -0.5), KERB_M, side.heading - np.pi / 2, rng.random())
            for block, density in enumerate(self.districts)
            for side in self.ground.sides(block, shortest_m=14)
            if rng.random() < (0.9 if density < 0 else 0.12)
        ])  # fmt: skip

    @cached_property
    def hedges(self) -> Mesh:
        """Hedges and fences along the gardens of detached houses."""
        rng = np.random.default_rng([self.seed, 7])
        b = self.buildings
        garden = np.flatnonzero(~b.attached.any(1) & (rng.random(len(b)) < 0.7))
        base, size, heading, kind = [], [], [], []
        for i in garden:
            w, d, _ = b.size[i]
            for x, wide in ((-0.32 * w - 0.8, 0.36 * w), (0.32 * w + 0.8, 0.36 * w)):
                y = -d / 2 - 2.1
                c, s = np.cos(b.heading[i]), np.sin(b.heading[i])
                base.append([b.position[i, 0] + c * x - s * y, b.position[i, 1] + s * x + c * y, KERB_M])
                tall = 0.9 + 0.7 * b.seed[i]
                hedge = b.seed[i] < 0.65
                size.append([wide, 0.55 if hedge else 0.06, tall])
                heading.append(b.heading[i])
                kind.append(Kind.HEDGE if hedge else Kind.FENCE)
        if not base:
            return Mesh.empty()
        where, extent, along, kinds = np.array(base), np.array(size), np.array(heading), np.array(kind)
        n = len(where)
        paint = FENCE_COLOURS[(rng.random(n) * len(FENCE_COLOURS)).astype(int)]
        colour = np.where((kinds == Kind.HEDGE)[:, None], HEDGE_GREEN, paint)
        rows = surface_rows(Kind.HEDGE, n, seed=rng.random(n), colour=colour, origin=where, heading=along)
        rows[:, KIND] = kinds
        clear = self._apart(where[:, :2], 1.1, along, 0.5 * extent[:, 0])
        clear &= self._clear(where[:, :2], 0.4) & ~shapely.contains_xy(self.ground.roads, where[:, 0], where[:, 1])
        return boxes(where[clear], extent[clear], along[clear], rows[clear])

    @cached_property
    def parking(self) -> Objects:
        """Parking places, half on the pavement; the seed determines which car is there."""
        rng = np.random.default_rng([self.seed, 8])
        rows = []
        for block in range(len(self.ground.blocks)):
            for side in self.ground.sides(block, inset=-PAVEMENT_M, shortest_m=24):
                s = 9.0
                while s < side.length - 11:
                    x, y = side.at(s + 2.6, 0.0)
                    rows.append((x, y, 0.0, side.heading + np.pi * (rng.random() < 0.08), rng.random()))
                    s += rng.uniform(5.4, 6.6)
        places = Objects.of(rows)
        x, y = places.rows[:, :2].T
        far_out = shapely.contains_xy(self.ground.roads.buffer(-0.75), x, y)  # sides follow a bent kerb only roughly
        return places.where(~far_out & self._apart(places.position[:, :2], 1.45, places.heading, 2.0))

    # -- appearance ----------------------------------------------------------------------------------------------------

    def mesh(self, appearance: Appearance, clear_of: Float64[ndarray, "c 2"] | None = None) -> Mesh:
        """All triangles of the town in an appearance.

        No car or person stands where a camera of ``clear_of`` (x, y) is.
        """
        a, fine = appearance, self.detail == "fine"
        change = [self.seed, 50, a.change_seed]
        repaint = np.random.default_rng([*change, 1]).random(len(self.buildings)) < a.facades_changed
        cars = self._parked(a)
        cars = cars.where(clear_of_cameras(cars.position[:, :2], cars.heading, clear_of, (2.9, 1.35)))
        green = [bool(d < 0.62) for d in self.districts]
        return Mesh.join([
            self.ground.mesh(green),
            building_mesh(self.buildings, repaint, a.change_seed, fine=fine, shapes=self._built[1]),
            tree_mesh(self.trees, a.foliage_density, LEAVES[self.detail]),
            objects.lamp_mesh(self.lamps.position, self.lamps.heading, fine=fine),
            objects.sign_mesh(self.signs.position, self.signs.heading, self.signs.seed),
            objects.bench_mesh(self.benches.position, self.benches.heading),
            self.hedges,
            objects.car_mesh(cars.position, cars.heading, cars.seed, fine=fine),
            self._traffic(a, fine, clear_of),
        ])  # fmt: skip

    def _parked(self, a: Appearance) -> Objects:
        """Parked cars: six places in ten are taken; a share ``cars_moved`` of the places is redrawn."""
        places = self.parking
        rng = np.random.default_rng([self.seed, 51, a.change_seed])
        again = rng.random(len(places.rows)) < a.cars_moved
        rows = places.rows.copy()
        rows[again, 4] = rng.random(int(again.sum()))
        return Objects(rows).where((rows[:, 4] * 7919 % 1) < 0.6)

    def _traffic(self, a: Appearance, fine: bool, clear_of: Float64[ndarray, "c 2"] | None) -> Mesh:
        """Moving cars in the lanes and people on the pavements, where no camera stands."""
        if a.traffic_per_100m == 0:
            return Mesh.empty()
        rng = np.random.default_rng([self.seed, 52, a.change_seed])
        graph = self.graph
        n = rng.poisson(graph.length_m / 100 * a.traffic_per_100m)
        edge: Int64[ndarray, "n"] = rng.choice(len(graph.edges), n, p=graph.lengths / graph.lengths.sum())
        start, end = graph.nodes[graph.edges[edge, 0]], graph.nodes[graph.edges[edge, 1]]
        along = (end - start) / graph.lengths[edge, None]
        way = np.where(rng.random(n) < 0.5, 1.0, -1.0)
        right = np.stack([along[:, 1], -along[:, 0]], -1) * way[:, None]
        walks = rng.random(n) < 0.6
        aside = np.where(walks, graph.widths[edge] / 2 + rng.uniform(1.5, 3.0, n), graph.widths[edge] / 4)
        place = start + along * (rng.uniform(0.08, 0.92, n) * graph.lengths[edge])[:, None] + right * aside[:, None]
        heading = np.arctan2(along[:, 1], along[:, 0]) + np.where(way > 0, 0.0, np.pi)
        seed = rng.random(n)
        away = clear_of_cameras(place, heading, clear_of, (3.6, 1.6))
        place, heading, seed, walks = place[away], heading[away], seed[away], walks[away]
        position = np.column_stack([place, np.where(walks, KERB_M, 0.0)])
        people = walks & self._apart(place, 0.9)
        cars = ~walks & self._apart(place, 1.45, heading, 2.0)
        return Mesh.join([
            objects.person_mesh(position[people], heading[people], seed[people]),
            objects.car_mesh(position[cars], heading[cars], seed[cars], fine=fine, moving=True),
        ])  # fmt: skip

    def renderer(
        self, appearance: Appearance, *, clear_of: Float64[ndarray, "c 2"] | None = None, soft: bool = False
    ) -> Renderer:
        """A renderer of the town in an appearance; appearances of equal ``structure`` may share it."""
        scene = Scene(self.mesh(appearance, clear_of), watertight=self.detail == "fine")
        lights = objects.lamp_lights(self.lamps.position, self.lamps.heading)
        return Renderer(scene, Lamps.at(lights), soft=soft)
