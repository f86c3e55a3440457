"""The benchmark of peers, on a made-up walk."""

import csv

import numpy as np
import pytest
from docs_commands import ROOT

from benchmarks.localization_peers import (
    FRAMES,
    JUDGED_FROM,
    LIMITS,
    MEASURES,
    along,
    main,
    measured,
    methods,
    summary,
)
from sextant import Localizer
from sextant.chapters.localization.localizer_folder import ENOUGH

IMAGES = 130


@pytest.fixture(scope="module")
def world():
    """A corridor of smooth noise, one picture a metre, and the same walk in other light."""
    rng = np.random.default_rng(0)
    wall = np.cumsum(rng.standard_normal((8, 400 + 4 * IMAGES)), axis=1)
    strips = np.stack([wall[:, 4 * k : 4 * k + 48] for k in range(IMAGES)])
    strips = (strips - strips.min((1, 2), keepdims=True)) / np.ptp(strips, axis=(1, 2), keepdims=True)
    images = np.repeat((255 * strips).astype(np.uint8).repeat(4, axis=1)[..., None], 3, axis=3)
    poses = np.zeros((IMAGES, 3))
    poses[:, 0] = np.arange(IMAGES)
    localizer = Localizer.from_images(images, poses, steps=5)
    seen = np.stack([localizer.describe((20 + 0.7 * image).astype(np.uint8)) for image in images])
    return localizer, localizer.model.map.descriptors.numpy(), seen


def test_a_walk_has_its_pace_and_odometry(world):
    _, known, seen = world
    even, uneven = (along(known, seen, 3, uneven=each) for each in (False, True))
    assert np.diff(even.truth[:, 0]).tolist() == [1.0] * (FRAMES - 1)
    assert set(np.diff(uneven.truth[:, 0])) <= {0.0, 1.0, 2.0}
    for walk in (even, uneven):
        steps = np.diff(walk.truth[:, 0])
        assert np.abs(walk.motion[1:, 0] - steps).max() < 0.6 * max(steps)
        np.testing.assert_array_equal(walk.seen, seen[walk.truth[:, 0].astype(int)])


@pytest.mark.slow
def test_all_methods_are_measured_on_the_same_walk(world):
    localizer, known, seen = world
    rows = []
    for seed in (0, 1):
        walk = along(known, seen, seed, uneven=False)
        parts = (each[: JUDGED_FROM + 20] for each in (walk.seen, walk.motion, walk.truth))
        short = type(walk)(walk.poses, walk.known, *parts)
        rows += [
            {"walk": "made up", "pace": "even", "seed": seed, **row}
            for row in measured(short, methods(localizer), seed, LIMITS["line"])
        ]
    shares = {}
    for row in rows:
        shares.setdefault(row["method"], []).append(row["within"])
    assert list(shares) == list(methods(localizer))
    assert min(shares["nearest image"] + shares["topological"] + shares["particles, 2,000"]) > 0.9
    lines = summary(rows)
    assert [line[2] for line in lines] == list(shares)
    assert lines[-1][4] == lines[-1][6] == ""  # ours is not compared with itself
    assert all(line[4] and line[6] for line in lines[:-1])


def test_the_table_of_the_docs_is_that_of_the_stored_seeds_with_the_default_descriptor():
    """What the page says of offices, made again from the stored values; these are of what is taken by default."""
    with (ROOT / "results" / "localization" / "peers" / "office.csv").open() as file:
        rows = [{**row, **{name: float(row[name]) for name in MEASURES}} for row in csv.DictReader(file)]
    assert {row["descriptor"] for row in rows} == {"network"}
    page = (ROOT / "results" / "localization_change.md").read_text().partition("The same (without a laser)")[0]
    for line in summary(rows):
        day = "summer" in line[0]
        name = "ours, " + line[2].removeprefix("particles, ") + " particles" if "particles, " in line[2] else line[2]
        name = "laser, 2,000 particles" if name.startswith("laser") else name
        (told,) = [
            each.replace("*", "") for each in page.splitlines() if each.replace("*", "").startswith(f"| {name} |")
        ]
        cells = [cell.strip() for cell in told.split("|")[2:-1]]
        assert cells[:4] == line[3:7] if day else cells[4:8] == line[3:7], name


def test_the_default_descriptor_is_of_the_size_of_images(monkeypatch):
    """The network of places where images show it enough, whitened components of small or grey ones."""
    poses = [(float(k), 0.0, 0.0) for k in range(8)]
    rng = np.random.default_rng(0)

    def taken(*shape):
        images = rng.integers(0, 256, (8, *shape), np.uint8)
        return Localizer.from_images(images, poses, steps=1).descriptor.facts["kind"]

    assert taken(ENOUGH, ENOUGH + 8, 3) == "network"
    assert taken(ENOUGH - 1, 80, 3) == "baseline"
    assert taken(ENOUGH, ENOUGH + 8, 1) == "baseline"


def test_walks_that_are_not_there_or_have_no_data_are_refused_before_any_work(monkeypatch):
    monkeypatch.delenv("SEXTANT_DATA", raising=False)
    for walks, said in (("nowhere", "no walk begins with this"), ("Nordland", "SEXTANT_DATA is not set")):
        monkeypatch.setattr("sys.argv", ["localization_peers", f"walks={walks}"])
        with pytest.raises(SystemExit, match=said):
            main()
