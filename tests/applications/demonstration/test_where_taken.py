"""Where a photo was taken in the rendered office, whose poses are known, and what is shown of the answer."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from sextant import cli
from sextant.correspondence import Pinhole
from sextant.errors import UserError
from sextant.tools.demonstration import posed_office
from sextant.tools.demonstration.posed_office import HEIGHT, SAMPLES, WIDTH, camera, kept_posed_office
from sextant.tools.demonstration.where_taken import WhereTaken, floor_of


@pytest.fixture(scope="module")
def office():
    pytest.importorskip("kornia")
    pytest.importorskip("poselib")
    return WhereTaken.in_office()


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SAMPLES if name.startswith(("day", "night"))])
def test_a_photo_of_the_office_is_located_where_it_was_taken(office, name):
    found = office.of_sample(name, same_camera=True)
    assert (found["verdict"], found["elsewhere"]) == ("located", False)
    rows = found["quantities"][:3]
    assert np.linalg.norm([row["values"][0] - row["truth"] for row in rows]) < 0.10  # map images are 0.5 m apart
    assert found["above"]["found"][:2] == pytest.approx([rows[0]["values"][0], rows[1]["values"][0]], abs=0.001)
    assert found["quantities"][-1]["values"][0] == pytest.approx(camera()[0], abs=0.1)
    lines = np.array(found["lines"])
    assert len(lines) > 20
    assert (lines >= 0).all()
    assert (lines <= [WIDTH, HEIGHT, WIDTH, HEIGHT]).all()


@pytest.mark.slow
def test_matches_are_drawn_where_both_pictures_look_alike(office):
    """Patches at the two ends of a line correlate, those of shuffled lines do not."""
    name = "day_2"
    found = office.of_sample(name, same_camera=True)
    photo = np.asarray(Image.open(office.samples[name]).convert("L"), float)
    near = np.asarray(office.images[office.poses.names.index(found["nearest"]["name"])], float).mean(2)
    lines = np.array([line for line in found["lines"] if all(12 < x < 228 for x in line)]) - 0.5

    def alike(pairs):
        patches = [(_patch(photo, x1, y1), _patch(near, x2, y2)) for x1, y1, x2, y2 in pairs]
        return np.median([np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in patches])

    shuffled = np.hstack([lines[:, :2], np.roll(lines[:, 2:], 3, axis=0)])
    assert alike(lines) > 0.6 > 0.4 > alike(shuffled)


def _patch(image, x, y, half=6):
    x, y = round(x), round(y)
    return image[y - half : y + half + 1, x - half : x + half + 1]


@pytest.mark.slow
@pytest.mark.parametrize("same_camera", [True, False])
@pytest.mark.parametrize("name", [name for name in SAMPLES if name.startswith("elsewhere")])
def test_another_office_is_not_in_the_map_and_the_map_is_shown_all_the_same(office, name, same_camera):
    found = office.of_sample(name, same_camera)
    assert (found["verdict"], found["elsewhere"]) == ("not in the map", True)
    assert (found["quantities"], found["nearest"], found["above"]["found"]) == ([], None, None)
    assert len(found["above"]["images"]) == len(office.poses.names)
    with pytest.raises(UserError, match="sample=attic: no such sample"):
        office.of_sample("attic")


@pytest.mark.slow
def test_a_saved_map_locates_without_its_photos(office, tmp_path):
    office.poses.save(tmp_path / "kept")
    found = WhereTaken.in_folder(tmp_path / "kept").answer(office.samples["day_2"])
    assert (found["verdict"], found["lines"]) == ("located", [])
    assert "picture" not in found["nearest"]
    assert len(found["dots"]) > 20


@pytest.mark.slow
def test_the_office_is_rendered_once_and_written_for_the_command(office, tmp_path, monkeypatch, capsys):
    kept = kept_posed_office()
    cli.run("data", ["posed", f"folder={tmp_path / 'my office'}"])
    assert f"sextant locate 'map={tmp_path / 'my office' / 'map'}'" in capsys.readouterr().out
    for path in kept.rglob("*.*"):
        assert (tmp_path / "my office" / path.relative_to(kept)).read_bytes() == path.read_bytes()
    monkeypatch.setattr(posed_office, "render_posed_office", None)
    assert kept_posed_office() == kept


def test_what_was_rendered_in_part_is_not_kept(tmp_path, monkeypatch):
    def interrupted(folder):
        (folder / "map").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path))
    monkeypatch.setattr(posed_office, "render_posed_office", interrupted)
    with pytest.raises(KeyboardInterrupt):
        kept_posed_office()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("sizes", "said"), [([(64, 48)], "no cameras of 80x60"), ([(80, 60, 50), (80, 60, 51)], "2 cameras of 80x60")]
)
def test_the_cameras_of_the_map_are_used_only_if_there_is_one_of_that_size(sizes, said, tmp_path):
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)).save(tmp_path / "a.png")
    cameras = [Pinhole.centred(width, height, *(focal or [50.0])) for width, height, *focal in sizes]
    where = WhereTaken("a map", SimpleNamespace(posed=SimpleNamespace(cameras=cameras)))
    with pytest.raises(UserError, match=said):
        where.answer(tmp_path / "a.png", same_camera=True)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("way", ["plane", "line", "nadir"])
def test_the_floor_is_found_whatever_the_axes_of_the_world(way, seed):
    """Cameras on a level plane or line look ahead, and those of an aircraft down; then the world is turned."""
    random = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, :2, 3] = random.normal(size=(20, 2)) * [4, 0 if way == "line" else 3]
    for pose in poses:
        heading, tilt = random.uniform(-1, 1), random.normal(scale=0.1)
        down = Rotation.from_euler("x", -90 if way != "nadir" else 180, degrees=True)
        pose[:3, :3] = (Rotation.from_rotvec([0, 0, heading]) * down * Rotation.from_rotvec([tilt, 0, 0])).as_matrix()
    world = Rotation.random(random_state=seed).as_matrix()
    turned = poses.copy()
    turned[:, :3] = world @ poses[:, :3]
    right, ahead = floor_of(turned)
    up = world[:, 2] if way != "nadir" else np.sign(np.cross(right, ahead) @ world[:, 2]) * world[:, 2]
    np.testing.assert_allclose(np.cross(right, ahead), up, atol=0.15)
    assert right @ ahead == pytest.approx(0, abs=1e-12)
