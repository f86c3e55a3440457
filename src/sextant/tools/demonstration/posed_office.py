"""A rendered office as a folder of posed photos, with photos to locate in it whose poses are known."""

import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image
from scipy.spatial.transform import Rotation

from sextant.atomic_files import write_csv
from sextant.cache_folder import cache_folder
from sextant.chapters.localization.data.posed_photos import CAMERA_COLUMNS, COLUMNS
from sextant.data.rendered import modules_sha256
from sextant.errors import naming_extras
from sextant.geometry import PerspectiveCamera, level_camera_pose

WIDTH, HEIGHT, VFOV = 320, 240, 1.05
#: rays of a pixel, and metres of the camera above the floor
RAYS, ABOVE_FLOOR = 4, 1.2
#: metres of the mapped drive and from one of its photos to the next; of the drive that is located
MAPPED, STEP, DRIVEN, APART = 16.0, 0.5, 3.0, 1.0
#: light of the map, and of the photos to locate by the beginning of their names; the last are of another office
MAP_LIGHT = "summer_noon"
LIGHTS = {"day": MAP_LIGHT, "night": "night_clear", (ELSEWHERE := "elsewhere"): MAP_LIGHT}
SAMPLES = tuple(f"{name}_{k}" for name in LIGHTS for k in range(round(DRIVEN / APART)))


def camera() -> tuple[float, float, float, float]:
    """Its (fx, fy, cx, cy) in pixels."""
    focal = HEIGHT / 2 / np.tan(VFOV / 2)
    return focal, focal, (WIDTH - 1) / 2, (HEIGHT - 1) / 2


@naming_extras("the rendered office")
def render_posed_office(folder: Path, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
    """Render the office to ``folder/map``, with ``poses.csv``, and photos to locate to ``folder/photos``.

    The map is a walk through the office by day, photographed every half metre. The photos to locate were taken between
    these, by day and at night, and in another office of the same builder. ``folder/truth.csv`` has the poses of those
    in this office.

    Args:
        folder: created if it does not exist; files of these names are replaced.
        progress: is given the photos done and their number.

    Raises:
        UserError: a package of the extra ``worlds`` is missing.
    """
    from sextant import worlds
    from sextant.worlds.office_routes import revisit, survey

    rays = worlds.Rays.of_camera(PerspectiveCamera.from_vfov(VFOV, WIDTH, HEIGHT), samples=RAYS)

    def office(seed: int) -> tuple[worlds.Office, ndarray, ndarray]:
        plan, random = worlds.procedural_plan((14.0, 10.0), seed), np.random.default_rng(seed)
        mapped = survey(plan, MAPPED, STEP, random)
        driven = revisit(plan, mapped[:, :2], DRIVEN, APART, random)
        tracks = tuple(plan.to_plan(drive[:, :2]) for drive in (mapped, driven))  # furniture keeps off them
        return worlds.Office(replace(plan, tracks=tracks), seed), mapped, driven

    here, mapped, driven = office(1)
    there, _, driven_there = office(2)
    views = [("map", "", here, mapped, MAP_LIGHT)]
    for name, light in LIGHTS.items():
        views.append(("photos", f"{name}_", *((there, driven_there) if name == ELSEWHERE else (here, driven)), light))
    total, done = sum(len(drive) for *_, drive, _ in views), 0
    rows: dict[str, list[Mapping[str, object]]] = {"map": [], "photos": []}
    for part, begin, building, drive, light in views:
        (folder / part).mkdir(parents=True, exist_ok=True)
        look = worlds.condition(light)
        renderer = building.renderer(look)
        for number, (x, y, heading) in enumerate(drive):
            pose = level_camera_pose(x, y, ABOVE_FLOOR, heading).double().numpy()
            path = folder / part / f"{begin}{number if begin else f'{number:02d}'}.png"
            Image.fromarray(renderer.picture(rays, pose, look, seed=done)).save(path)
            if building is here:
                rows[part].append(_row(path.name, pose))
            done += 1
            progress(done, total)
    for path, some in ((folder / "map" / "poses.csv", rows["map"]), (folder / "truth.csv", rows["photos"])):
        write_csv(path, (*COLUMNS, *CAMERA_COLUMNS), some)


def _row(name: str, pose: Float64[ndarray, "4 4"]) -> Mapping[str, object]:
    qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat().round(9).tolist()
    values = [*pose[:3, 3].round(6).tolist(), qw, qx, qy, qz, *np.round(camera(), 4).tolist()]
    return dict(zip((*COLUMNS, *CAMERA_COLUMNS), (name, *values), strict=True))


def kept_posed_office() -> Path:
    """The folder of the office in the cache, rendered there once for each version of the renderer.

    Raises:
        UserError: a package of the extra ``worlds`` is missing.
        OSError: it cannot be written.
    """
    source = modules_sha256("sextant.worlds", "sextant.geometry", __name__)
    folder = cache_folder() / f"posed_office-{source[:16]}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".posed_office-", dir=folder.parent))
        try:
            render_posed_office(made)
            os.replace(made, folder)
        except OSError:
            if not folder.is_dir():  # otherwise another process was faster
                raise
        finally:
            shutil.rmtree(made, ignore_errors=True)
    return folder
