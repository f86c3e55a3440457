"""A run of localization in a small rendered office, made once for all tests of a session."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from sextant.cli.assemble import build_dataset
from sextant.cli.compose import compose, to_plain
from sextant.cli.execute import execute
from sextant.config import validate
from sextant.data.localization import as_localization_source
from sextant.data.localization.drive import Drive

CHOSEN = (
    "task=localization", "dataset.size_m=[16.0,12.0]", "dataset.metres=[30.0,12.0,12.0]", "dataset.every=4",
    "dataset.width=48", "dataset.height=32", "dataset.samples=1", "dataset.conditions=[summer_noon]",
    "dataset.laser.beams=8", "dataset.seed=1", "descriptor.dimensions=32", "task.images=150",
    "task.validation_images=40", "task.starts=2", "task.horizon=25", "filter.particles=400",
    "trainer.max_epochs=2", "trainer.progress=false", "tracking=none",
)  # fmt: skip


_made = []


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
    """The run, made when it is first asked for; a fixture is not shared by modules that import it."""
    if not _made:
        _made.append(_office_run(tmp_path_factory))
    return _made[0]


def _office_run(tmp_path_factory):
    root = tmp_path_factory.mktemp("office")
    chosen = (*CHOSEN, f"paths.outputs={root / 'outputs'}", f"paths.cache={root}/cache", f"paths.data={root}/cache")
    raw = to_plain(compose(chosen))
    folder = execute(raw).directory
    data = as_localization_source(build_dataset(raw, validate(raw))).read()
    return OfficeRun(folder, root / "outputs", data.test[0], min(40, len(data.test[0])))


def pose_error(pose, truth):
    """Metres and degrees."""
    turned = (pose[2] - truth[2] + np.pi) % (2 * np.pi) - np.pi
    return np.hypot(*(pose[:2] - truth[:2])), abs(np.degrees(turned))
