"""Readers of reconstructions: against COLMAP's own files, against written ones, and on broken ones."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from data.reconstructions.written import WRITERS, colmap_binary, colmap_text, nerfstudio, opensfm, some_poses

from sextant.data.reconstructions import Lens, named_format, read_reconstruction
from sextant.errors import UserError

COLMAP = Path(__file__).parent / "colmap"
NAMES = ["2.jpg", "10.jpg", "left/a b.jpg"]


def read(path):
    return read_reconstruction(path, named_format(path))


@pytest.mark.parametrize("kind", ["text/images.txt", "binary/images.bin"])
def test_poses_are_those_that_colmap_gives_for_its_files(kind):
    """Written by pycolmap 4.2.1, ``world_from_camera`` too: ``image.cam_from_world().inverse()``."""
    truth = json.loads((COLMAP / "world_from_camera.json").read_text())
    found = read(COLMAP / kind)
    assert found.names == ["frame2.jpg", "frame10.jpg", "größe.png", "left/a photo of a street.jpg", "right/frame2.jpg"]
    assert np.abs(found.poses - np.array([truth[name] for name in found.names])).max() < 1e-9
    lenses = {image.name: image.lens for image in found.images}
    assert lenses["frame10.jpg"] == Lens("OPENCV_FISHEYE", 640, 480, 502.0)
    assert lenses["frame2.jpg"] == Lens("EQUIRECTANGULAR", 640, 480, None)
    assert lenses["left/a photo of a street.jpg"] == Lens("SIMPLE_RADIAL", 640, 480, 501.0)


@pytest.mark.parametrize("kind", WRITERS)
def test_what_is_written_is_read(kind, tmp_path):
    file, write = WRITERS[kind]
    path = write(tmp_path / file, NAMES, some_poses(3))
    assert named_format(path) == kind.split()[0]
    found = read(path)
    assert found.names == NAMES
    assert np.abs(found.poses - some_poses(3)).max() < 1e-12
    if kind == "colmap":  # without cameras.bin
        assert found.images[0].lens is None
    else:
        assert found.images[0].lens.focal_px == pytest.approx(500 if "text" in kind else 512)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_ends_anywhere_is_one_message(kind, tmp_path):
    file, write = WRITERS[kind]
    path = write(tmp_path / file, NAMES, some_poses(3))
    whole = path.read_bytes()
    for end in range(0, len(whole) - 40, 7):
        path.write_bytes(whole[:end])
        if kind == "colmap text" and whole[:end].splitlines()[1:]:
            continue  # the lines before are whole, and the last one may be
        with pytest.raises(UserError, match=re.escape(str(path))):
            read_reconstruction(path, kind.split()[0])


@pytest.mark.parametrize("kind", WRITERS)
def test_poses_that_are_none_are_named(kind, tmp_path):
    file, write = WRITERS[kind]
    poses = some_poses(3)
    path = write(tmp_path / file, NAMES, poses)
    if kind == "colmap":
        content = path.read_bytes()
        path.write_bytes(content.replace(struct.pack("<d", np.linalg.inv(poses[1])[0, 3]), struct.pack("<d", np.nan)))
    else:
        number = {"colmap text": np.linalg.inv(poses[1])[0, 3], "opensfm": np.linalg.inv(poses[1])[0, 3]}
        path.write_text(path.read_text().replace(repr(float(number.get(kind, poses[1, 0, 3]))), "NaN"))
    with pytest.raises(UserError, match="1 image cannot be used") as told:
        read(path)
    assert {"colmap": "10.jpg", "colmap text": "line 4", "opensfm": "10.jpg", "nerfstudio": "frame 2"}[kind] in str(
        told.value
    )


@pytest.mark.parametrize("kind", WRITERS)
def test_positions_further_away_than_any_camera_goes_are_named(kind, tmp_path):
    file, write = WRITERS[kind]
    poses = some_poses(3)
    poses[1, :3, 3] = 1e160
    with pytest.raises(
        UserError, match=r"1 image cannot be used\n  10.jpg: the position .* is further away than 1e\+09"
    ):
        read(write(tmp_path / file, NAMES, poses))


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("reconstruction.json", "[]", 'a list of reconstructions with "shots" is expected'),
        ("reconstruction.json", "[" * 100_000, "is not JSON"),
        ("reconstruction.json", '[{"shots": {}}]', "it has no posed image"),
        ("reconstruction.json", '[{"shots": {"a.jpg": 3}}]', "a.jpg: its rotation and translation"),
        ("transforms.json", "{}", 'a list of "frames" is expected'),
        ("transforms.json", '{"frames": [7]}', "frame 1: its file_path"),
        ("transforms.json", '{"frames": [{"file_path": "a", "transform_matrix": [[1, 2], [3]]}]}', "frame 1"),
        (
            "transforms.json",
            json.dumps({"frames": [{"file_path": "a", "transform_matrix": np.diag([2, 2, 2, 1]).tolist()}]}),
            "frame 1",
        ),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.jpg\n\n2 2 0 0 0 0 0 0 1 b.jpg\n", "line 3: the quaternion"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.jpg\n\n2 1 0 0 0 0 0 0 1 a.jpg\n\n", "1 image has two poses"),
    ],
)
def test_content_of_another_kind_is_one_message(file, content, said, tmp_path):
    (tmp_path / file).write_text(content)
    with pytest.raises(UserError) as told:
        read_reconstruction(tmp_path / file, {"r": "opensfm", "t": "nerfstudio", "i": "colmap"}[file[0]])
    assert said in str(told.value)


def test_cameras_of_a_model_that_is_not_known(tmp_path):
    path = colmap_binary(tmp_path / "images.bin", NAMES, some_poses(3))
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QIiQQ", 1, 1, 99, 640, 480))
    with pytest.raises(UserError, match="camera 1 has the model 99, which is not known here; known are SIMPLE_PINHOLE"):
        read(path)


def test_a_count_that_no_file_could_hold_ends_at_once(tmp_path):
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 2**63))
    with pytest.raises(UserError, match="truncated, or not a COLMAP file"):
        read(tmp_path / "images.bin")


def test_the_largest_of_several_reconstructions_is_taken(tmp_path):
    path = opensfm(tmp_path / "reconstruction.json", NAMES, some_poses(3))
    content = json.loads(path.read_text())
    small = {"shots": {"far.jpg": content[0]["shots"]["2.jpg"]}}
    path.write_text(json.dumps([small, *content]))
    found = read(path)
    assert found.names == NAMES
    assert found.remarks == ("the largest of 2 reconstructions; 1 image of the others is in other frames",)


def test_the_field_of_view_of_nerf_is_a_focal_length(tmp_path):
    path = nerfstudio(tmp_path / "transforms.json", ["train/r_0"], some_poses(1))
    content = json.loads(path.read_text())
    del content["fl_x"]
    path.write_text(json.dumps({**content, "camera_angle_x": np.pi / 2}))
    assert read(path).images[0].lens.focal_px == pytest.approx(320)


@pytest.mark.parametrize("value", [None, "wide", [1.0], float("nan")])
def test_a_lens_with_a_number_that_is_none_has_no_parameters(value, tmp_path):
    path = nerfstudio(tmp_path / "transforms.json", ["a.jpg"], some_poses(1))
    path.write_text(json.dumps({**json.loads(path.read_text()), "k1": value}))
    lens = read(path).images[0].lens
    assert (lens.opencv, lens.width) == (None, 640)
    path = opensfm(tmp_path / "reconstruction.json", ["a.jpg"], some_poses(1))
    assert read(path).images[0].lens.opencv is not None
    content = json.loads(path.read_text())
    content[0]["cameras"]["phone"]["k2"] = value
    path.write_text(json.dumps(content))
    assert read(path).images[0].lens.opencv is None


def test_files_are_found_by_the_ends_of_their_paths(tmp_path):
    names = ["images/left/1.png", "images/right/1.png", "train/r_0", "deep/only.jpg"]
    found = read(colmap_text(tmp_path / "images.txt", names, some_poses(4)))
    row = {name: k for k, name in enumerate(found.names)}
    asked = ["left/1.png", "right/1.png", "train/r_0.png", "other/only.jpg", "1.png", "missing.png"]
    expected = [row["images/left/1.png"], row["images/right/1.png"], row["train/r_0"], row["deep/only.jpg"], None, None]
    assert found.match(asked).rows == expected
    doubtful = found.match(["a/only.jpg", "b/only.jpg"])
    assert doubtful.rows == [None, None]
    assert doubtful.ambiguous == ("a/only.jpg and b/only.jpg may be deep/only.jpg",)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("poses.txt", "0 1 2 3 0 0 0 1\n"),  # TUM
        ("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n"),  # KITTI
        ("notes.txt", "a few words\n"),
        ("points3D.bin", "x"),
        ("empty.txt", ""),
        ("poses.json", "3"),
    ],
)
def test_other_files_are_not_taken_for_reconstructions(file, content, tmp_path):
    (tmp_path / file).write_text(content)
    assert named_format(tmp_path / file) is None
    assert named_format(tmp_path / "gone.txt") is None


# -- COLMAP's text with and without points -----------------------------------------------------------------------------

POINTS = ["1.5 2.5 -1", "10 20 7 11.5 21.5 -1 3 4 12", "0.0 0.0 0", ""]
LAYOUTS = {
    "points": [*POINTS],
    "no lines of points": [None] * 4,
    "empty lines": [""] * 4,
    "comments instead": ["# points"] * 4,
    "some lines": ["1.5 2.5 -1", None, "", None],
    "the last without": ["1.5 2.5 -1", "1.5 2.5 -1", "", None],
    "empty lines between": ["\n", "\n\n", "1.5 2.5 -1\n", "\n"],
    "comments between": ["# a\n1.5 2.5 -1", "# b", "\n# c\n1.5 2.5 -1", None],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("mark", "end"), [("", "\n"), ("\ufeff# Image list\n", "\r\n"), ("\n\n", "\n")])
def test_no_image_is_lost_whatever_lies_between(layout, mark, end, tmp_path):
    names, poses = ["a.jpg", "b c.jpg", "12 34 56.jpg", "d.jpg"], some_poses(4)
    path = colmap_text(tmp_path / "images.txt", names, poses)
    images = [line for line in path.read_text().splitlines() if ".jpg" in line]
    lines = [each for image, after in zip(images, LAYOUTS[layout], strict=True) for each in (image, after)]
    text = mark + "\n".join(line for line in lines if line is not None)
    path.write_bytes(text.replace("\n", end).encode())
    found = read(path)
    assert sorted(found.names) == sorted(names)
    assert np.abs(found.poses - poses[[names.index(name) for name in found.names]]).max() < 1e-9


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("3 1 0 0 0 0 0 0 1", "line 2: not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME: 3 1 0 0"),
        ("3 0.7 0.1 0.7 0.1 0 0 0 1", "line 2: not IMAGE_ID"),
        ("3 1 0 0 0 0 0 x 1 c.jpg", "line 2: not IMAGE_ID"),
        ("3 2 0 0 0 0 0 0 1 c.jpg", "line 2: the quaternion has not length 1"),
        ("1.5 2.5", "line 2: not IMAGE_ID"),
        ("1.5 nan -1", "line 2: not IMAGE_ID"),
        ("1.5 2.5 0.5", "line 2: not IMAGE_ID"),
        ("1.5 2.5 -1\n1.5 2.5 -1", "line 3: not IMAGE_ID"),
    ],
)
def test_a_line_that_is_neither_an_image_nor_points_is_named(line, said, tmp_path):
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 0 1 a.jpg\n{line}\n2 1 0 0 0 1 0 0 1 b.jpg\n")
    with pytest.raises(UserError, match=re.escape(said)):
        read_reconstruction(tmp_path / "images.txt", "colmap")
