"""Small worlds whose pictures are known in closed form, and a small town that several tests share."""

import hashlib
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np

from sextant.worlds.appearance import Appearance
from sextant.worlds.mesh import Mesh, boxes, instances, quads
from sextant.worlds.renderer import EXPOSURE, Rays, Renderer
from sextant.worlds.scene import Scene
from sextant.worlds.street_layouts import irregular_streets
from sextant.worlds.surfaces import KIND, Kind, surface_rows
from sextant.worlds.town import Town

#: no sun, no clouds to speak of: what is seen does not depend on shadows
OVERCAST = Appearance(cloud_cover=1.0)


def pinhole(width, height, hfov_deg, samples=1):
    """Rays of a pinhole camera, without torch."""
    side = round(samples**0.5)
    inside = (np.arange(side) + 0.5) / side
    focal = width / 2 / np.tan(np.radians(hfov_deg) / 2)
    x = (np.arange(width)[:, None] + inside - width / 2) / focal  # (w, n)
    y = (np.arange(height)[:, None] + inside - height / 2) / focal
    y, x = np.broadcast_arrays(y[:, None, :, None], x[None, :, None, :])
    ways = np.stack([x, y, np.ones_like(x)], -1).reshape(height, width, samples, 3)
    return Rays.of(ways / np.linalg.norm(ways, axis=-1, keepdims=True))


def pose(x, y, z, heading=0.0, tilt=0.0, roll=0.0):
    """World from camera, by the equation of `level_camera_pose`, without torch."""
    c, s = np.cos, np.sin
    level = np.array([[s(heading), 0, c(heading)], [-c(heading), 0, s(heading)], [0, -1, 0]])
    up = np.array([[1, 0, 0], [0, c(tilt), -s(tilt)], [0, s(tilt), c(tilt)]])
    turn = np.array([[c(roll), -s(roll), 0], [s(roll), c(roll), 0], [0, 0, 1]])
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = level @ up @ turn, (x, y, z)
    return out


def down(x, y, z):
    """A camera that looks straight down, world x to the right of the picture and y to its top."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.diag([1.0, -1.0, -1.0]), (x, y, z)
    return out


def rectangle(*corners, kind=Kind.PLAIN, **row):
    """A mesh of one quadrilateral, counter-clockwise seen from its front."""
    triangles = quads(np.array([corners], float)).reshape(1, 2, 3, 3)
    return instances(triangles, surface_rows(kind, 1, **row))


def floor(half=4096.0, x=0.0, y=0.0, z=0.0, **row):
    """A level square around (x, y)."""
    a, b, c, d = x - half, x + half, y - half, y + half
    return rectangle((a, c, z), (b, c, z), (b, d, z), (a, d, z), **row)


def box(base, size, heading=0.0, **row):
    """A closed box standing on ``base``."""
    row = surface_rows(Kind.PLAIN, 1, **row)
    return boxes(np.array([base], float), np.array([size], float), np.array([heading]), row, bottom=True)


def renderer(*meshes, **more):
    """A renderer of some meshes."""
    return Renderer(Scene(Mesh.join(meshes)), **more)


def undeveloped(picture, gamma=1.0):
    """Radiance before the tone curve of a picture in 8 bits: the inverse of gamma, shoulder and gain."""
    v = (np.asarray(picture) / 255.0) ** gamma
    a, b, c = 2.43 * v - 2.51, 0.59 * v - 0.03, 0.14 * v  # a x^2 + b x + c = 0
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0))
    return (-b - root) / (2 * a) / EXPOSURE


def first_met_from_behind(mesh, points, directions):
    """Kinds of the triangles that rays from outside first meet at their back."""
    scene = Scene(mesh)
    hit = scene.hit(points, directions)
    back = (hit >= 0) & (np.einsum("ij,ij->i", scene.normals[hit], directions) > 1e-6)
    return [Kind(int(kind)).name for kind in scene.surfaces[scene.surface[hit[back]], KIND]]


def rays_at(centre, radius, count, seed, *, above=True):
    """Rays from a sphere around ``centre`` at random points near it; from above only, or from all sides."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3))
    out[:, 2] = np.abs(out[:, 2]) if above else out[:, 2]
    start = centre + 8 * radius * out / np.linalg.norm(out, axis=1, keepdims=True)
    way = centre + rng.uniform(-radius, radius, (count, 3)) - start
    if above:
        way[:, 2] = np.minimum(way[:, 2], 0)
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)


def by_kind(mesh):
    """Number of triangles of each kind, by name."""
    kinds, counts = np.unique(mesh.surfaces[mesh.surface, KIND], return_counts=True)
    return {Kind(int(kind)).name: int(count) for kind, count in zip(kinds, counts, strict=True)}


@lru_cache
def small_town():
    """A town of four blocks."""
    return Town(irregular_streets(260.0, 80.0, 3), 3, detail="coarse")


@lru_cache(maxsize=4)
def _town_renderer(*structure):
    names = ("foliage_density", "facades_changed", "cars_moved", "traffic_per_100m", "change_seed")
    return small_town().renderer(Appearance(**dict(zip(names, structure, strict=True))))


def town_renderer(appearance):
    """A renderer of the small town; kept for appearances of one structure."""
    return _town_renderer(*appearance.structure)


@lru_cache
def town_poses(count=4):
    """Upright cameras in the streets of the small town."""
    graph = small_town().graph
    rng = np.random.default_rng(5)
    poses = []
    while len(poses) < count:
        a, b = graph.nodes[graph.edges[rng.integers(len(graph.edges))]]
        x, y = a + rng.uniform(0.3, 0.7) * (b - a)
        heading = np.arctan2(*(b - a)[::-1]) + rng.uniform(-0.4, 0.4)
        poses.append(pose(x, y, 1.6, heading))
    return np.array(poses)


def town_sha256(threads):
    """Hash of pictures of the small town with all that is random about them, drawn by so many threads."""
    look = Appearance(wetness=0.6, read_noise=0.01, shot_noise=0.02, exposure_time_s=0.03, lit_windows=0.3, night=0.2)
    drawer, rays, poses = town_renderer(look), pinhole(48, 32, 75, 4), town_poses(6)
    motions = np.array([[3.0, 1.0, 0.0, 0.2]] * len(poses))

    def draw(i):
        part = slice(i, i + 1)
        return drawer.pictures(rays, poses[part], look, motions=motions[part], seeds=np.array([i]))

    with ThreadPoolExecutor(threads) as pool:
        pictures = list(pool.map(draw, range(len(poses))))
    return hashlib.sha256(np.concatenate(pictures).tobytes()).hexdigest()
