"""What a localizer reports along drives, step by step, as it was recorded; rewritten by running this file.

Drives have gaps of images, unknown motion, odometry with a scale, and odometry that stands while the robot moves. The
record holds to the bit on one machine, and to rounding on others, whose sums have another order.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.saved_filter import usual_filter, usual_radius
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.kld_size import KLDSize
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.observation.local_gp import LocalGP
from sextant.localization.pose_kernel import PoseKernel

RECORD = Path(__file__).with_name("recorded_drives.json")
PLACES, DIMENSION, STEPS, UNKNOWN, STANDING = 60, 24, 48, range(12, 20), range(32, 42)
REPORTED = ("mass", "modes", "lost", "degenerate", "off_map", "foreseen", "recognised", "disbelieved")


def line_world(seed=5):
    """Poses two metres apart along a bend, descriptors that change smoothly along it, and a second drive's."""
    rng = np.random.default_rng(seed)
    turn = np.linspace(0.0, 1.2, PLACES)
    steps = 2 * np.stack([np.cos(turn), np.sin(turn)], 1)
    poses = np.concatenate([np.cumsum(steps, 0), turn[:, None]], 1)
    rough = np.cumsum(rng.normal(size=(PLACES + 8, DIMENSION)), 0)
    places = (rough[8:] - rough[:-8]) / 4  # places eight images apart have nothing in common
    again = places + 0.3 * rng.normal(size=places.shape) + 0.4
    return poses, places.astype(np.float32), again.astype(np.float32)


def made(model=None, **given):
    poses, places, _ = line_world()
    found = DescriptorMap.of(torch.from_numpy(poses), torch.from_numpy(places))
    kernel = PoseKernel("rbf", (4.0, 4.0), 0.6, 1.0, 0.02)
    usual = usual_filter(found.poses, kernel)
    changes = {name: given.pop(name) for name in ("kld", "apart", "support") if name in given}
    model = (model or CachedLocalGP(8, map_evidence="mean")).fit(found, kernel)
    return Localizer(
        model, Likelihood(tempering=0.125), replace(usual, **changes), radius=usual_radius(found.poses),
        particles=300, seed=3, **given,
    )  # fmt: skip


def inputs():
    """Motion (or None) and descriptor (or None) of each step."""
    poses, _, again = line_world()
    for step in range(STEPS):
        at = step + 4
        ahead = [2.0 / 1.15, 0.0, float(poses[at, 2] - poses[at - 1, 2])]
        motion = None if step in UNKNOWN else [0.0, 0.0, 0.0] if step in STANDING else ahead
        yield motion, None if step % 7 == 3 else again[at]
    for _ in range(4):  # standing, with odometry that says so
        yield [0.0, 0.0, 0.0], again[STEPS + 3]


DRIVES = {
    "adapting": lambda: made(adapts=True, odds=20.0, lag=5),
    "adapting, without odds, from the first image": lambda: made(adapts=True, start="appearance"),
    "adapting, local process, sizes by KLD": lambda: made(
        LocalGP(8), adapts=True, odds=20.0, kld=KLDSize(0.1, 0.05, 100, 600, 1.0, 0.3)
    ),
    "plain": lambda: made(lag=5),
    "plain, images apart, no support": lambda: made(apart=(3.0, 0.5), support=None, start="appearance"),
    "adapting, images apart": lambda: made(adapts=True, odds=20.0, apart=(3.0, 0.5)),
}


def row(told):
    return [*told.pose.tolist(), *told.covariance.ravel().tolist(), *(float(getattr(told, name)) for name in REPORTED)]


def along(localizer):
    rows = [[*row(localizer.step(motion, descriptor=image)), localizer.odometry_scale] for motion, image in inputs()]
    return {"steps": rows, "past": [row(told) for told in localizer.past()]}


def rounded(value):
    """Nine digits."""
    return float(f"{value:.9g}") if isinstance(value, float) else [rounded(each) for each in value]


@pytest.mark.parametrize("drive", DRIVES)
def test_a_drive_is_reported_as_it_was_recorded(drive):
    recorded, found = json.loads(RECORD.read_text())[drive], along(DRIVES[drive]())
    for part in ("steps", "past"):
        np.testing.assert_allclose(found[part], recorded[part], rtol=1e-6, atol=1e-6)


def test_the_drives_reach_every_part():
    rows = np.array(json.loads(RECORD.read_text())["adapting"]["steps"])
    columns = dict(zip(REPORTED, rows[:, 12:20].T, strict=True))
    assert columns["disbelieved"].any()
    assert not columns["disbelieved"].all()
    assert np.isfinite(columns["recognised"]).any()
    assert np.isfinite(columns["foreseen"]).any()
    assert abs(math.log(rows[-1, 20])) > 0.02
    assert 0 < columns["lost"].mean() < 1


if __name__ == "__main__":
    drives = {name: along(make()) for name, make in DRIVES.items()}
    told = {name: {part: rounded(rows) for part, rows in drive.items()} for name, drive in drives.items()}
    RECORD.write_text(json.dumps(told, separators=(",", ":")) + "\n")
