"""Maps whose poses were written down by whatever program."""

import numpy as np
import pytest
from data.places.gps_pictures import add_gps
from data.reconstructions.written import WRITERS
from PIL import Image

from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.errors import UserError
from sextant.tools.inspection import inspect
from sextant.tools.walks.posed_images import posed_images

COUNT = 6
POSES = np.column_stack([2.0 * np.arange(COUNT), 0.3 * np.arange(COUNT), np.full(COUNT, 0.15)])
NAMES = [f"{k}.png" for k in range(COUNT)]


@pytest.fixture
def images(tmp_path):
    (tmp_path / "images").mkdir()
    for k, name in enumerate(NAMES):
        Image.new("RGB", (48, 36), (40 * k, 20, 30)).save(tmp_path / "images" / name)
    return tmp_path


def in_space(poses):
    """World with z up, and cameras that look along their headings."""
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    for matrix, (x, y, turn) in zip(matrices, poses, strict=True):
        c, s = np.cos(turn), np.sin(turn)
        matrix[:3, :3] = [[s, 0, c], [-c, 0, s], [0, -1, 0]]
        matrix[:2, 3] = x, y
    return matrices


def table(folder):
    rows = [f"{name},{x},{y},{np.degrees(turn)}" for name, (x, y, turn) in zip(NAMES, POSES, strict=True)]
    (folder / "images" / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))


def tum(folder):
    write_tum(folder / "trajectory.txt", np.arange(COUNT, dtype=float), POSES)


def named(kind):
    def write(folder):
        file, writer = WRITERS[kind]
        (folder / "sparse").mkdir()
        prefix = "images/" if kind == "nerfstudio" else ""
        writer(folder / "sparse" / file, [prefix + name for name in NAMES], in_space(POSES))

    return write


@pytest.mark.parametrize(
    "write", [table, tum, *map(named, WRITERS)], ids=["csv", "tum", *WRITERS]
)  # fmt: skip
def test_poses_of_every_format_are_found(images, write):
    write(images)
    found = posed_images(images)
    assert [path.name for path in found.paths] == NAMES
    np.testing.assert_allclose(found.poses, POSES, atol=1e-6)
    assert found.source.is_file()


def test_gps_in_the_images_will_do(images):
    for k, name in enumerate(NAMES):
        add_gps(images / "images" / name, 3.0 * k, 0.0, 90.0)
    np.testing.assert_allclose(posed_images(images).poses[:, 0], 3.0 * np.arange(COUNT), atol=0.01)


def test_images_at_the_very_pose_of_another_are_left_out_if_that_is_asked_for(images):
    rows = [f"{name},1,2,3" for name in NAMES]
    (images / "images" / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))
    with pytest.raises(UserError, match="skip_bad=true"):
        posed_images(images)
    found = posed_images(images, skip_bad=True)
    assert len(found.paths) == 1
    assert f"left out {NAMES[1]} = {NAMES[0]}" in found.remarks


def test_positions_without_headings_are_no_poses(images):
    rows = [f"{name},{x},{y}" for name, (x, y, _) in zip(NAMES, POSES, strict=True)]
    (images / "images" / "poses.csv").write_text("\n".join(["file,x,y", *rows]))
    with pytest.raises(UserError, match=r"poses.csv: has positions, but no headings"):
        posed_images(images)


def test_without_poses_it_says_what_was_looked_for(images):
    with pytest.raises(UserError, match=r"neither a file there nor EXIF has poses of its images"):
        posed_images(images)
    (images / "poses.txt").write_text("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n")
    with pytest.raises(UserError, match=r"poses.txt: .*time 0.000000 is not after"):
        posed_images(images)
    (images / "poses.csv").write_text("a.jpg,1,2,3\n")
    with pytest.raises(UserError, match=r"poses.csv: columns a.jpg, 1, 2, 3; the first line must name file, x and y"):
        posed_images(images)
    (images / "poses.csv").write_text("")
    with pytest.raises(UserError, match=r"poses.csv: columns \(none\)"):
        posed_images(images)
    with pytest.raises(UserError, match="gone does not exist"):
        posed_images(images / "gone")


def test_of_several_models_the_largest_is_used_and_another_can_be_chosen(images):
    for model, count in ((0, COUNT), (1, 4)):
        folder = images / "sparse" / str(model)
        folder.mkdir(parents=True)
        WRITERS["colmap"][1](
            folder / "images.bin", NAMES[:count], in_space(POSES[:count] + np.array([50.0 * model, 0, 0]))
        )
    found = posed_images(images)
    assert found.source == images / "sparse/0/images.bin"
    said = "2 reconstructions, each in its own frame: sparse/0/images.bin (6 images), sparse/1/images.bin (4 images)"
    assert any(said in remark for remark in found.remarks)
    assert any(said in remark for remark in inspect(images).remarks)
    for name in NAMES[4:]:
        (images / "images" / name).unlink()
    chosen = posed_images(images / "sparse/1/images.bin")
    assert np.allclose(chosen.poses[:, 0], POSES[:4, 0] + 50)
    with pytest.raises(UserError, match=r"map=.*imagse does not exist; did you mean .*images\?"):
        posed_images(images / "imagse")


def test_a_partial_model_beside_another_is_refused_with_both(images):
    for model, names in ((0, NAMES[:4]), (1, NAMES[4:])):
        folder = images / "sparse" / str(model)
        folder.mkdir(parents=True)
        WRITERS["colmap"][1](folder / "images.bin", names, in_space(POSES[: len(names)]))
    with pytest.raises(UserError, match=r"2 of 6 images have no pose(.|\n)*2 reconstructions, each in its own frame"):
        posed_images(images)
