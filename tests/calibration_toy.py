"""Panoramas in which tilt, roll and field of view can be seen: a sky, a ground, and posts at even headings."""

import numpy as np
from PIL import Image

from sextant.chapters.calibration.data import CameraDistribution
from sextant.chapters.calibration.data.panoramas import Panoramas


class ToyPanoramas:
    """Six panoramas in each split, without files."""

    name = "toy"

    def files(self, split):
        return []

    def fingerprint(self):
        return "0" * 64

    def read(self, split):
        rng = np.random.default_rng([ord(letter) for letter in split])
        return Panoramas([panorama(rng) for _ in range(6)], [f"{split}_{i}" for i in range(6)])


def panorama(rng, height=64):
    rows, columns = np.mgrid[:height, : 2 * height]
    sky = rows < height / 2
    image = np.where(sky[..., None], rng.integers(150, 250, 3), rng.integers(20, 110, 3)).astype(float)
    posts = (columns // 4 + rng.integers(8)) % 8 == 0
    image[posts & (abs(rows - height / 2) < height / 5)] = rng.integers(0, 255, 3)
    return np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8)


def panorama_files(folder, count=10):
    """A folder of panoramas."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    for i in range(count):
        Image.fromarray(panorama(rng)).save(folder / f"scene{i}.png")
    return folder


def panorama_words(folder, outputs, *overrides):
    """What is typed for a run on such a folder."""
    return [
        "task=calibration", "dataset=panorama_folder", f"dataset.folder={folder}", "dataset.height=64",
        "dataset.fractions={train: 0.4, val: 0.4, test: 0.2}", "task.width=64", "task.height=48",
        "task.crops_per_panorama={train: 8, val: 8, test: 3}", f"paths.outputs={outputs}", *overrides,
    ]  # fmt: skip


def distribution():
    return CameraDistribution(
        name="toy",
        tilt={"kind": "uniform", "low": -0.3, "high": 0.3},
        tilt_as="rho",
        roll={"kind": "uniform", "low": -0.4, "high": 0.4},
        roll_as="roll_rad",
        focal={"kind": "uniform", "low": 50, "high": 90},
        focal_as="vfov_deg",
        k1={"kind": "uniform", "low": -0.2, "high": 0},
        k1_as="k1",
        k2_of_k1="lopez",
        aspect={"4:3": 1},
        portrait=0,
    )
