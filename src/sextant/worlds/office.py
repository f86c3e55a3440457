"""A procedural office: what stands where, from a floor plan and a seed, and its triangles in an appearance."""

from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float, Float64
from numpy import ndarray

from sextant.worlds.appearance import Appearance
from sextant.worlds.mesh import Mesh
from sextant.worlds.office_furniture import clutter, sheet
from sextant.worlds.office_lights import RoomLights, room_fills, room_lights
from sextant.worlds.office_parts import Parts, Point, turned
from sextant.worlds.office_plan import Box, FloorPlan, RoomKind
from sextant.worlds.office_rooms import Furnisher, Furnishing, Thing, keep_clear, shifted
from sextant.worlds.office_shell import leaf_frame, shell
from sextant.worlds.renderer import Renderer
from sextant.worlds.scene import Scene
from sextant.worlds.street_objects import person_mesh


class Office:
    """One floor of offices that is the same for the same plan and seed.

    How an ``Appearance`` is interpreted indoors:

    - ``night``, ``cloud_cover`` and the sun's height: daylight through the windows. The lamps of corridors, halls and
      rooms without windows are always on; four in ten of the other rooms have theirs on in bright daylight, all of
      them at night and on dull days.
    - ``cars_moved``: share of the chairs and of the small things on desks that were moved.
    - ``facades_changed``: share of posters and pinboards that were replaced.
    - ``traffic_per_100m``: people standing about, per 100 square metres of floor.
    - ``change_seed``: which of these change. Snow, rain, fog and leaves stay outside.

    Args:
        plan: its rooms, doors and windows.
        seed: furniture, colours and posters.
    """

    def __init__(self, plan: FloorPlan, seed: int):
        self.plan, self.seed = plan, seed

    @property
    def floor_area_m2(self) -> float:
        """Square metres of all rooms."""
        return self.plan.floor_area_m2

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x and y, largest x and y of the building in the world, metres."""
        return self.plan.bounds

    def check_poses(self, poses: Float[ndarray, "n c"], clearance_m: float = 0.0) -> None:
        """Check that poses (x, y, ...) stand on free floor; see ``FloorPlan.check_poses``.

        Raises:
            UserError: one does not; names its index and position.
        """
        self.plan.check_poses(poses, clearance_m)

    @cached_property
    def fills(self) -> list[Point]:
        """For each room: light scattered from its lamps and windows, and the share of lamps that are on by day."""
        rng = np.random.default_rng([self.seed, 1])
        windows = {window.room for window in self.plan.windows}
        always = {RoomKind.CORRIDOR, RoomKind.HALL}
        lit = [
            1.0 if room.kind in always or number not in windows or luck < 0.4 else 0.0
            for number, (room, luck) in enumerate(zip(self.plan.rooms, rng.random(len(self.plan.rooms)), strict=True))
        ]
        return room_fills(self.plan, np.array(lit))

    @cached_property
    def furnishing(self) -> Furnishing:
        """Everything in the rooms, before anything is moved."""
        return Furnisher(self.plan, self.seed, self.fills).furnish()

    @cached_property
    def _shell(self) -> Mesh:
        return shell(self.plan, self.seed, self.fills)

    # -- appearance ----------------------------------------------------------------------------------------------------

    def _things(self, a: Appearance) -> list[Thing]:
        """Furniture in appearance ``a``: a share ``cars_moved`` of what is loose has been moved."""
        found = list(self.furnishing.things)
        rng = np.random.default_rng([self.seed, 51, a.change_seed])
        loose = [i for i, thing in enumerate(found) if thing.reach > 0]
        chosen = [i for i, luck in zip(loose, rng.random(len(loose)), strict=True) if luck < a.cars_moved]
        tracks = keep_clear(self.plan)
        leaves = self._leaves()
        for i in chosen:
            others = [t.box for k, t in enumerate(found) if k != i and t.room == found[i].room and t.box is not None]
            own = np.random.default_rng([self.seed, 52, a.change_seed, i])
            found[i] = shifted(found[i], others + leaves, self.plan, tracks, own)
        return found

    def _leaves(self) -> list[Box]:
        """The floor area that open door leaves cover."""
        boxes = []
        for door in self.plan.doors:
            if door.leaf == "open":
                hinge, _ = leaf_frame(self.plan, door, (0.0, 0.0, 0.0))
                ends = np.array([(hinge.x, hinge.y), hinge.at(door.width, 0.0)])
                low, high = ends.min(0) - 0.08, ends.max(0) + 0.08
                boxes.append((float(low[0]), float(low[1]), float(high[0]), float(high[1])))
        return boxes

    def _people(self, a: Appearance, there: list[Box]) -> Float64[ndarray, "n 5"]:
        """x, y, heading, seed and room of the people who stand about, clear of tracks and furniture."""
        rng = np.random.default_rng([self.seed, 53, a.change_seed])
        wanted = rng.poisson(a.traffic_per_100m * self.floor_area_m2 / 100) if a.traffic_per_100m > 0 else 0
        area = np.array([room.area_m2 for room in self.plan.rooms])
        tracks, people = keep_clear(self.plan), []
        for _ in range(int(wanted)):
            for _ in range(20):
                number = int(rng.choice(len(area), p=area / area.sum()))
                x0, y0, x1, y1 = self.plan.rooms[number].box
                x, y = rng.uniform((x0 + 0.35, y0 + 0.35), (x1 - 0.35, y1 - 0.35))
                body = (x - 0.3, y - 0.3, x + 0.3, y + 0.3)
                apart = all(body[0] > b[2] or b[0] > body[2] or body[1] > b[3] or b[1] > body[3] for b in there)
                if apart and (tracks is None or not shapely.intersects(tracks, shapely.box(*body))):
                    people.append((x, y, rng.uniform(-np.pi, np.pi), rng.random(), number))
                    there = [*there, body]
                    break
        return np.array(people).reshape(-1, 5)

    def mesh(self, appearance: Appearance) -> Mesh:
        """All triangles of the office in an appearance, in the world."""
        a, parts = appearance, Parts()
        things = self._things(a)
        for thing in things:
            thing.draw(parts, thing.frame)
        rng = np.random.default_rng([self.seed, 54, a.change_seed])
        moved = rng.random(len(self.furnishing.desktops)) < a.cars_moved
        for desktop, again in zip(self.furnishing.desktops, moved, strict=True):
            seed = [desktop.seed, a.change_seed + 1] if again else desktop.seed
            clutter(parts, desktop.frame, 0.74, np.random.default_rng(seed))
        changed = rng.random(len(self.furnishing.sheets)) < a.facades_changed
        for hung, again in zip(self.furnishing.sheets, changed, strict=True):
            kind, print_seed = rng.random(2) if again else hung.seeds
            if again and (kind > 0.7) != (hung.seeds[0] > 0.7):
                kind = (kind + 0.5) % 1  # a pinboard mostly remains one, with other notes
            sheet(parts, hung.frame, hung.size, hung.z, float(kind), float(print_seed))
        there = [thing.box for thing in things if thing.box is not None] + self._leaves()
        for x, y, heading, own, number in self._people(a, there):
            body = person_mesh(np.array([[x, y, 0.0]]), np.array([heading]), np.array([own]))
            parts.add(body, self.fills[int(number)])
        return turned(Mesh.join([self._shell, parts.mesh()]), self.plan.heading, self.plan.origin)

    def lights(self, appearance: Appearance) -> RoomLights:
        """Lamps and windows, and the contact shadows of what stands on the floor in an appearance."""
        things = self._things(appearance)
        dark = [(thing.box, thing.shade) for thing in things if thing.box is not None]
        people = self._people(appearance, [box for box, _ in dark] + self._leaves())
        dark += [((x - 0.15, y - 0.15, x + 0.15, y + 0.15), 0.8) for x, y, *_ in people.tolist()]
        return room_lights(self.plan, [(box, depth) for box, depth in dark] + [(box, 0.35) for box in self._leaves()])

    def renderer(self, appearance: Appearance) -> Renderer:
        """A renderer of the office in an appearance; appearances of equal ``structure`` may share it."""
        return Renderer(Scene(self.mesh(appearance)), self.lights(appearance), indoor=True)
