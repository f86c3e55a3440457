"""Pictures of a world: exact rays of any camera, Embree for what they meet, compiled shading for what is seen there."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, UInt8
from numpy import ndarray

from sextant.errors import UserError
from sextant.worlds.appearance import Appearance
from sextant.worlds.lamps import Lamps
from sextant.worlds.scene import MISS, Scene
from sextant.worlds.shading import kernels
from sextant.worlds.shading.look import WET, pack, white_balance

#: rays shaded at a time: bounds the memory of a large picture
CHUNK = 1 << 18
#: times that a ray may slip between leaves
GAPS = 3


class PixelRays(Protocol):
    """What the renderer asks of a camera: any camera of ``sextant.geometry``."""

    width: int
    height: int

    def ray_grid(self, samples_per_side: int) -> object:
        """Unit directions in the camera frame, ``(height, width, samples_per_side^2, 3)``."""


@dataclass(frozen=True)
class Rays:
    """The rays of a camera in its own frame, worked out once and used for every pose.

    Attributes:
        bearings: unit directions, the samples of a pixel next to each other, pixels row by row.
        samples: rays a pixel.
        pixel: angle between neighbouring rays in radians, for the filtering of textures.
    """

    bearings: Float64[ndarray, "r 3"]
    width: int
    height: int
    samples: int
    pixel: float

    @classmethod
    def of(cls, bearings: Float[ndarray, "h w s 3"]) -> "Rays":
        """Rays from unit directions given by pixel and sample."""
        height, width, samples = bearings.shape[:3]
        middle = bearings[height // 2, :, 0]
        pixel = float(np.median(np.linalg.norm(np.diff(middle, axis=0), axis=-1))) if width > 1 else 1.0
        return cls(np.ascontiguousarray(bearings.reshape(-1, 3), np.float64), width, height, samples, pixel)


@dataclass(frozen=True)
class Motion:
    """How the camera moves while the shutter is open.

    Attributes:
        velocity: metres a second, world frame.
        turn_rate: radians a second about world z.
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rate: float = 0.0


STILL = Motion()


@dataclass(frozen=True)
class View:
    """What a camera sees before its sensor.

    Attributes:
        radiance: linear RGB.
        distance_m: along the ray of each pixel's first sample, infinite in the sky.
        surface: row of the scene's surface table met by that ray, -1 in the sky.
    """

    radiance: Float32[ndarray, "h w 3"]
    distance_m: Float64[ndarray, "h w"]
    surface: Int32[ndarray, "h w"]


class Renderer:
    """Renders one scene. Threads may share it; a picture is the same whichever thread draws it.

    Args:
        scene: triangles and their surfaces.
        lamps: lights of the night.
        indoor: a world without sun, lit by its ceilings.
    """

    def __init__(self, scene: Scene, lamps: Lamps | None = None, *, indoor: bool = False):
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
        """The developed picture, 8 bits a channel; ``seed`` varies the sensor noise alone."""
        view = self.view(rays, world_from_camera, appearance, motion=motion)
        out = np.empty((rays.height * rays.width, 3), np.uint8)
        a = appearance
        gain = white_balance(a.temperature_k) * 2.0**a.exposure_ev * EXPOSURE
        kernels.develop(
            view.radiance.reshape(-1, 3), rays.width, gain, a.gamma, a.read_noise, a.shot_noise, a.vignetting, seed, out
        )
        return out.reshape(rays.height, rays.width, 3)

    def view(
        self,
        rays: Rays,
        world_from_camera: Float64[ndarray, "4 4"],
        appearance: Appearance,
        *,
        motion: Motion = STILL,
    ) -> View:
        """Radiance, exact distance and surface of every pixel."""
        pose = np.ascontiguousarray(world_from_camera[:3], np.float64)
        if not np.isfinite(pose).all():
            raise UserError(f"a camera pose is not finite: {pose.tolist()}")
        look = pack(appearance, indoor=self.indoor)
        shutter = appearance.exposure_time_s
        drift, turn = np.array(motion.velocity) * shutter, motion.turn_rate * shutter
        pixels = rays.width * rays.height
        radiance = np.empty((pixels, 3), np.float32)
        distance = np.empty(pixels)
        surface = np.empty(pixels, np.int32)
        step = max(1, CHUNK // rays.samples)
        for start in range(0, pixels, step):
            part = slice(start, min(start + step, pixels))
            cast = slice(part.start * rays.samples, part.stop * rays.samples)
            light, met, far = self._trace(rays.bearings[cast], cast.start, pose, drift, turn, look, rays.pixel)
            kernels.average(light, rays.samples, radiance[part])
            first = met[:: rays.samples]
            distance[part] = far[:: rays.samples]
            surface[part] = np.where(first == MISS, MISS, self.scene.surface[first])
        shape = (rays.height, rays.width)
        return View(radiance.reshape(*shape, 3), distance.reshape(shape), surface.reshape(shape))

    def _trace(
        self,
        bearings: Float64[ndarray, "r 3"],
        first: int,
        pose: Float64[ndarray, "3 4"],
        drift: Float64[ndarray, "3"],
        turn: float,
        look: Float64[ndarray, "l"],
        pixel: float,
    ) -> tuple[Float32[ndarray, "r 3"], Int32[ndarray, "r"], Float64[ndarray, "r"]]:
        origins = np.empty((len(bearings), 3), np.float32)
        directions = np.empty((len(bearings), 3), np.float32)
        kernels.world_rays(pose, bearings, first, drift, turn, origins, directions)
        triangle, distance = self._meet(origins, directions, pixel)
        radiance, mirror = self._light(origins, directions, triangle, distance, look, pixel)
        if look[WET] > 0:
            self._reflect(origins, directions, distance, radiance, mirror, look, pixel)
        return radiance, triangle, distance

    def _meet(
        self, origins: Float32[ndarray, "r 3"], directions: Float32[ndarray, "r 3"], pixel: float
    ) -> tuple[Int32[ndarray, "r"], Float64[ndarray, "r"]]:
        """The first thing along each ray, where foliage lets some rays through."""
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

    def _light(
        self,
        origins: Float32[ndarray, "r 3"],
        directions: Float32[ndarray, "r 3"],
        triangle: Int32[ndarray, "r"],
        distance: Float64[ndarray, "r"],
        look: Float64[ndarray, "l"],
        pixel: float,
    ) -> tuple[Float32[ndarray, "r 3"], Float32[ndarray, "r"]]:
        scene, n = self.scene, len(origins)
        sunny = np.zeros(n, np.uint8)
        at, starts = np.empty(n, np.int64), np.empty((n, 3), np.float32)
        count = kernels.shadow_rays(
            origins, directions, triangle, distance, scene.normals, scene.surface, scene.surfaces, look, at, starts
        )
        if count:
            to_sun = np.empty((count, 3), np.float32)
            to_sun[:] = look[:3]
            sunny[at[:count]] = scene.blocked(starts[:count], to_sun) == MISS
        radiance, mirror = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        lamps = self.lamps
        kernels.shade(
            origins, directions, triangle, distance, sunny, scene.normals, scene.surface, scene.surfaces,
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
    ) -> None:
        """Adds what wet ground mirrors, by one more cast."""
        at = np.empty(len(mirror), np.int64)
        starts, ways = np.empty((len(mirror), 3), np.float32), np.empty((len(mirror), 3), np.float32)
        count = kernels.mirror_rays(origins, directions, distance, mirror, at, starts, ways)
        if count:
            at, starts, ways = at[:count], starts[:count], ways[:count]
            triangle, onward = self._meet(starts, ways, 3 * pixel)
            seen, _ = self._light(starts, ways, triangle, onward, look, 3 * pixel)
            radiance[at] += mirror[at, None] * np.minimum(seen, 4.0)

    def pictures(
        self,
        rays: Rays,
        poses: Float64[ndarray, "n 4 4"],
        appearance: Appearance,
        *,
        motions: list[Motion] | None = None,
        seeds: list[int] | None = None,
        threads: int = 1,
    ) -> Iterator[UInt8[ndarray, "h w 3"]]:
        """Pictures at many poses, in order; threads change the speed, never a byte."""
        n = len(poses)
        motions, seeds = motions or [STILL] * n, seeds or list(range(n))

        def one(i: int) -> UInt8[ndarray, "h w 3"]:
            return self.picture(rays, poses[i], appearance, motion=motions[i], seed=seeds[i])

        if threads == 1:
            yield from map(one, range(n))
        else:
            with ThreadPoolExecutor(threads) as pool:
                yield from pool.map(one, range(n))


#: gain that shows a white wall in the noon sun just below white
EXPOSURE = 0.62
