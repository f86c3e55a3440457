"""Pictures of a world: the exact rays of any camera, Embree for what they hit, compiled shading for how it looks."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int32, Int64, UInt8
from numpy import ndarray

from sextant.errors import UserError
from sextant.geometry import Camera
from sextant.worlds.appearance import Appearance
from sextant.worlds.lamps import Lamps
from sextant.worlds.scene import MISS, Scene
from sextant.worlds.shading import kernels
from sextant.worlds.shading.look import WET, pack, white_balance

#: rays shaded at a time, which limits the memory for a large picture
CHUNK = 1 << 17
#: how often a ray may slip between leaves
GAPS = 3
#: gain that shows a white wall in the noon sun just below white
EXPOSURE = 0.62


@dataclass(frozen=True)
class Rays:
    """The rays of a camera in its own frame, computed once and used for every pose.

    Attributes:
        bearings: unit directions; the samples of a pixel are adjacent, and pixels go row by row.
        samples: rays per pixel.
        pixel: angle between neighbouring rays in radians, for the filtering of textures.
    """

    bearings: Float64[ndarray, "r 3"]
    width: int
    height: int
    samples: int
    pixel: float

    @classmethod
    def of(cls, bearings: Float[ndarray, "h w s 3"]) -> "Rays":
        """Rays from unit directions, given for each pixel and sample."""
        height, width, samples = bearings.shape[:3]
        middle = bearings[height // 2, :, 0]
        pixel = float(np.median(np.linalg.norm(np.diff(middle, axis=0), axis=-1))) if width > 1 else 1.0
        return cls(np.ascontiguousarray(bearings.reshape(-1, 3), np.float64), width, height, samples, pixel)

    @classmethod
    def of_camera(cls, camera: Camera, samples: int) -> "Rays":
        """The exact rays of any camera, ``samples`` per pixel on a regular grid.

        Raises:
            UserError: ``samples`` is not a square number from 1 to 64.
        """
        side = round(samples**0.5)
        if side * side != samples or not 1 <= samples <= 64:
            raise UserError(f"samples={samples}: rays per pixel must be a square number", "Choose 1, 4, 9 or 16.")
        return cls.of(camera.bearings(camera.ray_grid(side, dtype=torch.float64)).numpy())


@dataclass(frozen=True)
class Motion:
    """How the camera moves while the shutter is open.

    Attributes:
        velocity: metres per second, world frame.
        turn_rate: radians per second about world z.
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rate: float = 0.0


STILL = Motion()


@dataclass(frozen=True)
class View:
    """What a camera sees, before its sensor.

    Attributes:
        radiance: linear RGB.
        distance_m: along the ray of each pixel's first sample, infinite in the sky.
        surface: row of the scene's surface table that this ray hits, -1 in the sky.
    """

    radiance: Float32[ndarray, "h w 3"]
    distance_m: Float64[ndarray, "h w"]
    surface: Int32[ndarray, "h w"]


class Renderer:
    """Renders one scene. Threads may share it; a picture is the same whichever thread draws it.

    Args:
        scene: triangles and their surfaces.
        lamps: lights at night.
        indoor: whether the world has no sun and is lit by its ceilings.
        soft: cast one more ray per sample to find how much sky each point sees: soft shade under cars and eaves, but
            grain unless there are many samples per pixel. For pictures that people look at.
    """

    def __init__(self, scene: Scene, lamps: Lamps | None = None, *, indoor: bool = False, soft: bool = False):
        self.soft = soft
        self.scene = scene
        self.lamps = lamps or Lamps.at(np.zeros((0, 3)))
        self.indoor = indoor

    def picture(
        self,
        rays: Rays,
        world_from_camera: Float64[ndarray, "4 4"],
        appearance: Appearance,
        *,
        motion: Motion = STILL,
        seed: int = 0,
    ) -> UInt8[ndarray, "h w 3"]:
        """One developed picture; see :meth:`pictures`."""
        motions = np.array([[*motion.velocity, motion.turn_rate]])
        pictures = self.pictures(rays, world_from_camera[None], appearance, motions=motions, seeds=np.array([seed]))
        return np.asarray(pictures[0])

    def pictures(
        self,
        rays: Rays,
        world_from_camera: Float64[ndarray, "n 4 4"],
        appearance: Appearance,
        *,
        motions: Float64[ndarray, "n 4"] | None = None,
        seeds: Int64[ndarray, "n"] | None = None,
    ) -> UInt8[ndarray, "n h w 3"]:
        """Developed pictures, 8 bits per channel. Each is the same whichever others are asked for with it.

        Args:
            motions: velocity in metres per second along world x, y, z and turn rate in radians per second about z.
            seeds: of the sensor noise.

        Raises:
            UserError: a pose is not finite, or lies inside a wall.
        """
        check_poses(self.scene, world_from_camera)
        n, pixels = len(world_from_camera), rays.width * rays.height
        out = np.empty((n, pixels, 3), np.uint8)
        gain = white_balance(appearance.temperature_k) * 2.0**appearance.exposure_ev * EXPOSURE
        curve = gamma_curve(appearance.gamma)
        together = max(1, CHUNK // len(rays.bearings))
        for start in range(0, n, together):
            part = slice(start, min(start + together, n))
            moving = None if motions is None else motions[part]
            radiance, _ = self._views(rays, world_from_camera[part], appearance, moving)
            for i in range(part.start, part.stop):
                kernels.develop(
                    radiance[i - start], rays.width, gain, curve, appearance.read_noise, appearance.shot_noise,
                    appearance.vignetting, 0 if seeds is None else int(seeds[i]), out[i],
                )  # fmt: skip
        return out.reshape(n, rays.height, rays.width, 3)

    def view(
        self, rays: Rays, world_from_camera: Float64[ndarray, "4 4"], appearance: Appearance, *, motion: Motion = STILL
    ) -> View:
        """Radiance, exact distance and surface of every pixel."""
        check_poses(self.scene, world_from_camera[None])
        motions = np.array([[*motion.velocity, motion.turn_rate]])
        radiance, triangle = self._views(rays, world_from_camera[None], appearance, motions)
        origins, directions = np.empty((2, *rays.bearings.shape))  # in float64 for the distance
        shift = motions[0] * appearance.exposure_time_s
        kernels.world_rays(
            np.ascontiguousarray(world_from_camera[:3], np.float64), rays.bearings, 0, shift, origins, directions
        )
        distance = self.scene.plane_distance(origins[:: rays.samples], directions[:: rays.samples], triangle[0])
        surface = np.where(triangle == MISS, MISS, self.scene.surface[triangle]).astype(np.int32)
        shape = (rays.height, rays.width)
        return View(radiance.reshape(*shape, 3), distance.reshape(shape), surface.reshape(shape))

    def _views(
        self,
        rays: Rays,
        world_from_camera: Float64[ndarray, "n 4 4"],
        appearance: Appearance,
        motions: Float64[ndarray, "n 4"] | None,
    ) -> tuple[Float32[ndarray, "n p 3"], Int32[ndarray, "n p"]]:
        """Radiance of every pixel of some views, and the triangle hit by its first ray."""
        n, per_view, samples = len(world_from_camera), len(rays.bearings), rays.samples
        poses = np.ascontiguousarray(world_from_camera[:, :3], np.float64)
        shift = np.zeros((n, 4)) if motions is None else motions * appearance.exposure_time_s
        look = pack(appearance, indoor=self.indoor)
        radiance = np.empty((n, per_view // samples, 3), np.float32)
        triangle = np.empty((n, per_view // samples), np.int32)
        step = per_view if per_view <= CHUNK else CHUNK // samples * samples
        for start in range(0, per_view, step):
            cast = slice(start, min(start + step, per_view))
            part = slice(cast.start // samples, cast.stop // samples)
            count = cast.stop - cast.start
            origins, directions = np.empty((2, n * count, 3), np.float32)
            for i in range(n):
                own = slice(i * count, (i + 1) * count)
                kernels.world_rays(poses[i], rays.bearings[cast], start, shift[i], origins[own], directions[own])
            met, far = self._meet(origins, directions, rays.pixel)
            number = np.tile(np.arange(cast.start, cast.stop, dtype=np.int32), n)  # of each ray in its own view
            light, mirror = self._light(origins, directions, met, far, look, rays.pixel, number, samples)
            if look[WET] > 0:
                self._reflect(origins, directions, far, light, mirror, look, rays.pixel, number, samples)
            mean = np.empty((n * count // samples, 3), np.float32)
            kernels.average(light, samples, mean)
            radiance[:, part] = mean.reshape(n, -1, 3)
            triangle[:, part] = met[::samples].reshape(n, -1)
        return radiance, triangle

    def _meet(
        self, origins: Float32[ndarray, "r 3"], directions: Float32[ndarray, "r 3"], pixel: float
    ) -> tuple[Int32[ndarray, "r"], Float64[ndarray, "r"]]:
        """The first triangle along each ray; foliage lets some rays through."""
        scene = self.scene
        triangle = scene.hit(origins, directions)
        distance = np.empty(len(origins))
        kernels.distances(origins, directions, triangle, scene.normals, scene.offsets, distance)
        slipped = np.empty(len(origins), np.int64)
        for _ in range(GAPS):
            count = kernels.gaps(origins, directions, triangle, distance, scene.surface, scene.surfaces, pixel, slipped)
            if count == 0:
                break
            at = slipped[:count]
            on = distance[at] + 1e-3
            starts = origins[at] + (directions[at] * on[:, None]).astype(np.float32)
            behind = scene.hit(starts, directions[at])
            triangle[at] = behind
            further = np.empty(count)
            kernels.distances(origins[at], directions[at], behind, scene.normals, scene.offsets, further)
            distance[at] = further
        return triangle, distance

    def _ask_sun(
        self,
        triangle: Int32[ndarray, "r"],
        at: Int64[ndarray, "k"],
        starts: Float32[ndarray, "k 3"],
        look: Float64[ndarray, "l"],
        samples: int,
        sunny: UInt8[ndarray, "r"],
    ) -> None:
        """Set ``sunny`` for the rays ``at``, skipping those of a pixel on one triangle whose corners agree."""

        to_sun = np.empty_like(starts)
        to_sun[:] = look[:3]
        if samples == 1:
            sunny[at] = self.scene.blocked(starts, to_sun) == MISS
            return
        chosen, froms = np.empty(len(at), np.int64), np.empty_like(starts)
        for choose in (kernels.corner_rays, kernels.inner_rays):
            count = choose(triangle, at, starts, samples, sunny, chosen, froms)
            sunny[chosen[:count]] = self.scene.blocked(froms[:count], to_sun[:count]) == MISS

    def _light(
        self,
        origins: Float32[ndarray, "r 3"],
        directions: Float32[ndarray, "r 3"],
        triangle: Int32[ndarray, "r"],
        distance: Float64[ndarray, "r"],
        look: Float64[ndarray, "l"],
        pixel: float,
        number: Int32[ndarray, "r"],
        samples: int,
        *,
        grouped: bool = True,
    ) -> tuple[Float32[ndarray, "r 3"], Float32[ndarray, "r"]]:
        """Radiance along each ray, and the share that wet ground reflects; finds the points that see sun and sky."""
        scene, n = self.scene, len(origins)
        sunny = np.zeros(n, np.uint8)
        at, starts = np.empty(n, np.int64), np.empty((n, 3), np.float32)
        count = kernels.shadow_rays(
            origins, directions, triangle, distance, scene.normals, scene.surface, scene.surfaces, look, at, starts
        )
        self._ask_sun(triangle, at[:count], starts[:count], look, samples if grouped else 1, sunny)
        open_sky = np.full(n, -1.0, np.float32)
        if self.soft:
            ways = np.empty((n, 3), np.float32)
            count = kernels.sky_rays(
                origins, directions, triangle, distance, scene.normals, scene.surface, scene.surfaces,
                number, samples, at, starts, ways,
            )  # fmt: skip
            open_sky[at[:count]] = scene.blocked(starts[:count], ways[:count]) == MISS
        radiance, mirror = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        lamps = self.lamps
        kernels.shade(
            origins, directions, triangle, distance, sunny, open_sky, scene.normals, scene.surface, scene.surfaces,
            lamps.position, lamps.cells, lamps.origin, look, pixel, radiance, mirror,
        )  # fmt: skip
        return radiance, mirror

    def _reflect(
        self,
        origins: Float32[ndarray, "r 3"],
        directions: Float32[ndarray, "r 3"],
        distance: Float64[ndarray, "r"],
        radiance: Float32[ndarray, "r 3"],
        mirror: Float32[ndarray, "r"],
        look: Float64[ndarray, "l"],
        pixel: float,
        number: Int32[ndarray, "r"],
        samples: int,
    ) -> None:
        """Add what wet ground reflects, by one more cast."""
        at = np.empty(len(mirror), np.int64)
        starts, ways = np.empty((len(mirror), 3), np.float32), np.empty((len(mirror), 3), np.float32)
        count = kernels.mirror_rays(origins, directions, distance, mirror, at, starts, ways)
        if count:
            at, starts, ways = at[:count], starts[:count], ways[:count]
            triangle, onward = self._meet(starts, ways, 3 * pixel)
            seen, _ = self._light(starts, ways, triangle, onward, look, 3 * pixel, number[at], samples, grouped=False)
            radiance[at] += mirror[at, None] * np.minimum(seen, 4.0)


def check_poses(scene: Scene, world_from_camera: Float64[ndarray, "n 4 4"]) -> None:
    """Raise a ``UserError`` for poses that are not finite or lie inside a solid; it names the first."""
    finite = np.isfinite(world_from_camera).all((1, 2))
    bad = np.flatnonzero(~finite)
    if not len(bad):
        bad = np.flatnonzero(scene.inside(world_from_camera[:, :3, 3]))
    if len(bad):
        x, y, z = world_from_camera[bad[0], :3, 3]
        what = "lies inside a wall" if finite.all() else "is not finite"
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise UserError(
            f"camera pose {bad[0]} at ({x:.2f}, {y:.2f}, {z:.2f}) {what}{more}",
            "Place cameras in streets or rooms: routes and the shots of the datasets do.",
        )


@lru_cache(maxsize=16)
def gamma_curve(gamma: float) -> UInt8[ndarray, "65536"]:
    """Display values of the 65,536 levels of a linear picture in [0, 1]: ``255 v^(1 / gamma)``, rounded."""
    levels = np.arange(65536) / 65535
    return np.round(255 * levels ** (1 / gamma)).astype(np.uint8)
