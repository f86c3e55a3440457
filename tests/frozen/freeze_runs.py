"""Runs, maps and sweeps as they are stored: ``python tests/frozen/freeze_runs.py`` writes ``runs.tar.xz`` anew.

Tiny runs of each task with the pictures that they read, a place map, a localizer, a finished sweep and one that was cut
off after two of its four runs. Figures and logs are left out: they hold nothing that is read again.
"""

import contextlib
import io
import shutil
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
import numpy as np
from calibration_toy import panorama
from PIL import Image
from support import QUICK
from tiny_digits import PLAIN
from tiny_digits import QUICK as QUICK_COSFIRE
from tiny_office import OFFICE
from tiny_office import QUICK as QUICK_OFFICE
from tiny_places import ride

import sextant
from sextant.atomic_files import write_json

HERE = Path(__file__).parent
NAME = "runs.tar.xz"
TASKS = ("classification", "cosfire", "place_recognition", "calibration", "localization")
ARMS = ("inhibition=none,push_pull", "seed=0,1")
DROPPED = ("figures", "history.jsonl", "cache", "contact_sheet.png")


def words_of(task: str, data: Path) -> list[str]:
    """The overrides of a tiny run of a task; ``data`` holds the pictures of :func:`write_pictures`."""
    quiet = ["trainer.progress=false", "tracking=none"]
    if task == "classification":
        return [*QUICK, "backbone=strided_cnn", "backbone.widths=[8,8]", "tracking=none"]
    if task == "cosfire":
        return without_twice([*QUICK_COSFIRE, *PLAIN])
    if task == "localization":
        return without_twice([f"task={task}", *OFFICE, *QUICK_OFFICE, "task.images=60", "task.save_map=true"])
    sizes = ["trainer.max_epochs=2", "trainer.batch_size=16"]
    if task == "place_recognition":
        split = [f"{name}={{day: {name}/day, night: {name}/night}}" for name in ("train", "val")]
        split += ["test={reference: test/day, query: test/night}"]
        folders = [f"dataset.{each}" for each in split]
        size = ["dataset.height=32", "dataset.width=48", "pooling.grid=null", "task.dimension=8"]
        size += ["task.baselines=false", "task.batch_places=8"]
        dataset = ["dataset=place_folders", f"dataset.folder={data}", "dataset.places=order"]
        return [f"task={task}", *dataset, *folders, *size, "backbone.widths=[8,8]", *sizes, *quiet]
    dataset = ["dataset=panorama_folder", f"dataset.folder={data / 'panoramas'}", "dataset.height=64"]
    size = ["task.width=24", "task.height=18", "task.features=16", "backbone=strided_cnn", "backbone.widths=[8,8]"]
    return [f"task={task}", *dataset, *size, *sizes, *quiet]


def without_twice(words: list[str]) -> list[str]:
    """The last of the overrides of each key."""
    return list({word.partition("=")[0]: word for word in words}.values())


def write_pictures(data: Path) -> None:
    """Places by day and by night, and panoramas of which each is a scene of its own."""
    for first, split in enumerate(("train", "val", "test")):
        for light in ("day", "night"):
            ride(data / split / light, range(8 * first, 8 * first + 8), night=light == "night")
    (data / "panoramas").mkdir(parents=True)
    for number in range(10):
        Image.fromarray(panorama(np.random.default_rng(number))).save(data / "panoramas" / f"{number}.png")


def write_all(root: Path) -> None:
    """Pictures in ``data``, runs and sweeps in ``outputs``, ``map`` and ``localizer`` beside them."""
    data, outputs = root / "data", root / "outputs"
    write_pictures(data)
    where = [f"paths.outputs={outputs}", f"paths.cache={root / 'cache'}"]
    runs = {}
    for task in TASKS:
        runs[task] = sextant.run([*words_of(task, data), *where]).directory
    quick = [*words_of("classification", data), *ARMS, *where]
    sextant.sweep(overrides=[*quick])
    half = sextant.sweep(overrides=[*quick, "optimizer.lr=0.03"])
    for cell in half.cells[-2:]:
        shutil.rmtree(outputs / cell.run)
    places = sextant.PlaceMap.load(runs["place_recognition"])
    places.add(data / "test" / "day")
    places.save(root / "map")
    sextant.Localizer.load(runs["localization"]).save(root / "localizer")
    write_json(root / "answers.json", answers(root))


def answers(root: Path) -> dict[str, Any]:
    """What the stored map and localizer say of pictures."""
    queries = sorted((root / "data" / "test" / "night").iterdir())
    places = sextant.PlaceMap.open(root / "map")
    matched = [places.look_up(query).best for query in queries]
    localizer = sextant.Localizer.load(root / "localizer")
    poses = [localizer.step((0.1, 0.0, 0.0), query).pose for query in queries]
    return {
        "matches": [[Path(best.photo).name, best.similarity] for best in matched],
        "poses": [list(map(float, pose)) for pose in poses],
    }


def pack(root: Path, path: Path) -> None:
    """The files below ``root`` but those that are never read again, with the same bytes whenever it is written."""
    with tarfile.open(path, "w:xz", preset=9) as archive:
        for file in sorted(each for each in root.rglob("*") if each.is_file()):
            name = file.relative_to(root)
            if not set(name.parts).intersection(DROPPED):
                entry = tarfile.TarInfo(name.as_posix())
                entry.size = file.stat().st_size
                archive.addfile(entry, io.BytesIO(file.read_bytes()))


if __name__ == "__main__":
    root = Path(tempfile.gettempdir()) / "frozen"  # the name is in the configs of the runs
    root.mkdir()
    with contextlib.chdir(root):
        write_all(root)
    pack(root, HERE / NAME)
    shutil.rmtree(root)
    print(f"{(HERE / NAME).stat().st_size:>8} {NAME}")
