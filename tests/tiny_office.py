"""Small offices, rendered once for all tests of a session: quick runs by day and by night, and a finished one."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from sextant.cache_folder import cache_folder
from sextant.chapters.localization.data import as_localization_source
from sextant.chapters.localization.data.drive import Drive
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.kit.assemble import build_dataset
from sextant.lifecycle.execute import execute

LASER = "{beams: 60, field_of_view_rad: 3.14159, max_range_m: 15.0, range_sigma_m: 0.02, dropout: 0.01}"
#: 250 images of the map, 100 for validation and 120 for the test, by each of two lights
OFFICE = (
    "dataset=office_walk", "dataset.size_m=[14.0, 12.0]", "dataset.metres=[40.0, 8.0, 16.0]", "dataset.every=4",
    "dataset.width=24", "dataset.height=16", "dataset.samples=1", "dataset.conditions=[summer_noon, night_clear]",
    f"dataset.laser={LASER}",
)  # fmt: skip
QUICK = (
    "task.starts=3", "task.horizon=30", "task.replay=false", "task.save_map=false", "filter.particles=200",
    "descriptor.height=16", "descriptor.width=24", "descriptor.dimensions=16", "trainer.max_epochs=2",
    "trainer.progress=false", "tracking=none",
)  # fmt: skip
#: of the finished run: by day alone, larger and seen more sharply, so that it knows well where it is
SHARP = (
    "dataset.size_m=[16.0,12.0]", "dataset.metres=[30.0,12.0,12.0]", "dataset.width=48", "dataset.height=32",
    "dataset.conditions=[summer_noon]", "dataset.laser.beams=8", "dataset.seed=1", "descriptor.height=32",
    "descriptor.width=48", "descriptor.dimensions=32", "task.images=150", "task.validation_images=40", "task.starts=2",
    "task.horizon=25", "task.replay=true", "task.save_map=true", "filter.particles=400",
)  # fmt: skip


def office_cache() -> Path:
    """The folder that the office is rendered into, and descriptors are kept in, by all workers of pytest-xdist."""
    return cache_folder() / "tiny_office"


def office_arguments(cache: Path, outputs: Path, *overrides: str) -> list[str]:
    """The command line of a run; ``overrides`` take the place of what is usual."""
    given = {override.partition("=")[0].lstrip("+") for override in overrides}
    usual = ["task=localization", *OFFICE, *QUICK, f"paths.cache={cache}", f"paths.outputs={outputs}"]
    groups = {name for name in given if "." not in name}
    kept = [each for each in usual if each.partition("=")[0] not in given and each.partition(".")[0] not in groups]
    return [*kept, *overrides]


def office_config(cache: Path, outputs: Path, *overrides: str) -> dict:
    """The plain config of a run."""
    return to_plain(compose(office_arguments(cache, outputs, *overrides)))


@dataclass(frozen=True)
class OfficeRun:
    """A finished run, and a drive that was localized in it."""

    folder: Path
    outputs: Path
    drive: Drive
    frames: int

    @property
    def images(self):
        return self.drive.images[: self.frames]

    @property
    def motions(self):
        """None for the first frame, as nothing is known of the way to it."""
        return [None, *self.drive.motion[1 : self.frames]]

    def photos(self, folder, name="{k:04d}.png"):
        """The frames of the drive as files without loss."""
        folder.mkdir(parents=True, exist_ok=True)
        for k, image in enumerate(self.images):
            Image.fromarray(image).save(folder / name.format(k=k))
        return folder

    def steps(self, localizer):
        return [localizer.step(m, image) for m, image in zip(self.motions, self.images, strict=True)]


def office_run(tmp_path_factory):
    """Train the run."""
    root = tmp_path_factory.mktemp("office")
    raw = office_config(office_cache(), root / "outputs", *SHARP)
    folder = execute(raw).directory
    data = as_localization_source(build_dataset(validate(raw))).read()
    return OfficeRun(folder, root / "outputs", data.test[0], min(40, len(data.test[0])))


def pose_error(pose, truth):
    """Metres and degrees."""
    turned = (pose[2] - truth[2] + np.pi) % (2 * np.pi) - np.pi
    return np.hypot(*(pose[:2] - truth[:2])), abs(np.degrees(turned))
