"""Rendered pictures per second, and their cost relative to casting the same rays with Embree alone."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from sextant.data.worlds.shots import camera_poses
from sextant.data.worlds.towns import perspective, street_poses
from sextant.geometry import EquirectangularCamera
from sextant.worlds.appearance import condition
from sextant.worlds.renderer import Rays
from sextant.worlds.street_layouts import irregular_streets
from sextant.worlds.town import Town

THREADS = 2


def run() -> list[tuple[str, str, str, str, str]]:
    torch.set_num_threads(1)
    graph = irregular_streets(700, 90, seed=1)
    town = Town(graph, seed=1)
    noon = condition("summer_noon")
    renderer = town.renderer(noon)
    poses = camera_poses(street_poses(graph, 32, np.random.default_rng(0)))
    rows = []
    for name, camera, views in (
        ("panorama 1024x512", EquirectangularCamera(1024, 512), 2),
        ("street view 96x64", perspective(96, 64, 55), 32),
    ):
        for samples in (1, 4):
            rays, some = Rays.of_camera(camera, samples), poses[:views]
            origins = np.repeat(some[:, :3, 3], len(rays.bearings), axis=0).astype(np.float32)
            directions = np.concatenate([rays.bearings @ pose[:3, :3].T for pose in some]).astype(np.float32)
            bare = medians({"cast": lambda o=origins, d=directions: renderer.scene.hit(o, d)}, 5)["cast"] / views
            whole = medians({"render": lambda r=rays, p=some: renderer.pictures(r, p, noon)}, 5)["render"] / views
            with ThreadPoolExecutor(THREADS) as pool:

                def together(r=rays, p=some) -> list[object]:
                    return list(pool.map(lambda _: renderer.pictures(r, p, noon), range(THREADS)))

                rate = THREADS * views / medians({"together": together}, 3)["together"]
            rows.append((
                f"{name}, {samples} ray{'s' * (samples > 1)} per pixel, {len(renderer.scene):,} triangles",
                f"{1e3 * whole:.2f} ms, {rate:,.1f} fps on {THREADS} threads",
                f"bare Embree cast {1e3 * bare:.2f} ms",
                f"{whole / bare:.2f}",
                "<= 6",
            ))  # fmt: skip
    return rows
