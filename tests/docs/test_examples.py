"""Examples in Python of README and docs, each of which is run as it is written, or has a reason not to be."""

import re

import numpy as np
import pytest
import tiny_places
import torch
from cli.cosfire_detection.drawn import drawn
from docs_commands import PAGES, ROOT
from support import as_published
from tiny_calibration import tiny_checkpoint
from torch import nn

from sextant import Localizer
from sextant.models import ResNetCifar

BLOCKS = [
    (page.name, block)
    for page in PAGES
    if page.name != "adding.md"  # whose examples are files too: test_adding.py
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
]
#: what an example holds that is not run, and why
NOT_RUN = {
    "TiledMapBuilder(folder)": "streams a map of its own; smaller in tests/localization",
    "localize_walk(": "needs a walk and a map; tests/applications/walks",
    "load_store(": "needs a town, which takes minutes to render; smaller in tests/data/rendered",
    "sextant.sweep(": "trains four networks; tests/lifecycle/test_library.py runs it and reads what it prints",
    "town.renderer(look)": "renders for half a minute; smaller in tests/worlds",
}
#: what an example holds that takes long
SLOW = ("Landmarks(",)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Trained models of each task, by the placeholder of their run."""
    folder = tmp_path_factory.mktemp("models")
    torch.manual_seed(0)
    random = np.random.default_rng(0)
    images = random.integers(0, 256, (24, 12, 16, 3), np.uint8)
    poses = np.column_stack([np.arange(24.0), np.zeros(24), np.zeros(24)])
    Localizer.from_images(images, poses, steps=2, particles=50).save(folder / "map")
    return {
        "outputs/runs/calibration/<run>": tiny_checkpoint(folder / "calibration" / "last.ckpt"),
        "outputs/runs/classification/<run>": as_published(ResNetCifar(3, (32, 32), 10), folder / "model.pth.tar"),
        "outputs/runs/localization/<run>": folder / "map",
        "outputs/runs/place_recognition/<run>": tiny_places.tiny_checkpoint(folder / "places" / "last.ckpt"),
    }


@pytest.fixture
def names(tmp_path, monkeypatch):
    """What the pages take for granted: names, and files in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path / "outputs"))
    for folder in ("docs", "results", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    drawn(tmp_path / "photo.jpg", (400, 300), glyphs=((310, 190),))
    for k in range(4):
        drawn(tmp_path / "photos" / f"{k}.png", (400, 300), glyphs=((100 + 90 * k, 150),))
    (tmp_path / "photos" / "broken.jpg").write_bytes(b"")
    (tmp_path / "odometry.csv").write_text("x,y,theta\n0,0,0\n1,0,0.1\n")
    for light in ("day", "night"):
        tiny_places.ride(tmp_path / light, range(12), night=light == "night")
    image = np.zeros((12, 16, 3), np.uint8)
    return {
        "images": torch.rand(4, 1, 48, 64),
        "example": torch.rand(1, 48, 64),
        "network": nn.Sequential(nn.Conv2d(1, 4, 5, padding=2), nn.ReLU()),
        "my_network": nn.Sequential(nn.Conv2d(3, 4, 3), nn.ReLU()),
        "robot": [(None, image), ((1.0, 0.0, 0.0), image)],
    }


@pytest.mark.parametrize(
    ("page", "block"),
    [
        pytest.param(page, block, marks=[pytest.mark.slow] * any(word in block for word in SLOW))
        for page, block in BLOCKS
        if not any(text in block for text in NOT_RUN)
    ],
)
def test_an_example_runs_as_it_is_written(page, block, models, names):
    if page == "corruptions.md":
        names["images"] = torch.rand(4, 3, 32, 32)
    for placeholder, path in models.items():
        block = block.replace(placeholder, str(path))
    exec(block, names)


@pytest.mark.parametrize("text", NOT_RUN)
def test_no_reason_is_left_over(text):
    assert sum(text in block for _, block in BLOCKS) == 1
