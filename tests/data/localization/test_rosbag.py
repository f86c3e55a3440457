"""ROS bags of both versions, written by the package ``rosbags``, read as drives."""

import io

import numpy as np
import pytest
from made_up_bags import Bags
from PIL import Image

from sextant.chapters.localization.data.own_drive import open_drive
from sextant.chapters.localization.data.rosbag import is_rosbag, open_rosbag
from sextant.errors import UserError

SIZE = (4, 6, 3)
PICTURE = np.random.default_rng(0).integers(0, 256, SIZE, dtype=np.uint8)


@pytest.fixture(params=[1, 2])
def bags(request):
    return Bags(request.param)


@pytest.mark.parametrize("name", ["drive", "walk.mp4", "WALK.AVI"])
def test_a_folder_of_a_drive_without_photos_names_the_drive(bags, name, tmp_path):
    if name == "drive":
        path = bags.write(tmp_path, [("/camera", 1, bags.image(1, PICTURE))])
    else:
        (path := tmp_path / name).write_bytes(b"video")
    with pytest.raises(UserError) as found:
        open_drive(str(tmp_path), None, tmp_path / "found")
    assert found.value.problem == f"input={tmp_path}: no photo there, but {path.name}"
    assert found.value.fix == f"input={path}"


def seen(bag):
    return [frame.image for frame in bag.read(SIZE)]


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
def test_images_have_their_colours_whatever_their_layout(bags, tmp_path, encoding, padding):
    pixels = PICTURE if encoding.startswith("rgb") else PICTURE[..., ::-1]
    if encoding.endswith("a8"):
        pixels = np.dstack([pixels, np.full(SIZE[:2], 9, np.uint8)])
    path = bags.write(tmp_path, [("/camera", 1, bags.image(1, pixels, encoding, padding))])
    assert is_rosbag(path)
    np.testing.assert_array_equal(seen(open_rosbag(path)), [PICTURE])


def test_compressed_images_are_decoded_and_damaged_ones_named(bags, tmp_path):
    file = io.BytesIO()
    Image.fromarray(PICTURE).save(file, "png")
    messages = [bags.compressed(1, file.getvalue()), bags.compressed(2, b"no picture")]
    path = bags.write(tmp_path, [("/camera/compressed", i + 1, message) for i, message in enumerate(messages)])
    first, second = open_rosbag(path).read(SIZE)
    np.testing.assert_array_equal(first.image, PICTURE)
    assert second.image is None
    assert "cannot be decoded" in second.problem


def test_an_encoding_that_is_not_known_is_named(bags, tmp_path):
    path = bags.write(tmp_path, [("/camera", 1, bags.image(1, PICTURE, encoding="yuv422"))])
    (frame,) = open_rosbag(path).read(SIZE)
    assert "encoding yuv422 is not one of mono8" in frame.problem


def test_motion_is_that_of_the_odometry_at_the_times_of_the_headers(bags, tmp_path):
    poses = [("/odom", t, bags.odometry(t, x=2.0 * t, heading=0.1 * t)) for t in range(1, 6)]
    images = [
        ("/camera", t + 0.2, bags.image(t, PICTURE)) for t in (1.5, 2.5, 4.0)
    ]  # recorded late: their headers count
    path = bags.write(tmp_path, sorted([*poses, *images], key=lambda message: message[1]))
    drive = open_drive(str(path), None, tmp_path / "out")
    np.testing.assert_allclose(drive.times_s, [1.5, 2.5, 4.0])
    assert drive.motions[0] is None
    np.testing.assert_allclose(np.hypot(*drive.motions[1][:2]), 2.0, atol=1e-6)
    np.testing.assert_allclose([motion[2] for motion in drive.motions[1:]], [0.1, 0.15], atol=1e-6)
    assert drive.remarks == []


def test_every_other_image_is_taken_with_its_time(bags, tmp_path):
    images = [bags.image(t, np.full(SIZE, t, np.uint8)) for t in range(1, 6)]
    bag = open_rosbag(bags.write(tmp_path, [("/camera", t + 1, image) for t, image in enumerate(images)]), every=2)
    assert [image.max() for image in seen(bag)] == [1, 3, 5]
    np.testing.assert_allclose(bag.times_s, [1, 3, 5])
    assert bag.names == ("image 0", "image 2", "image 4")


def test_headers_without_times_leave_those_of_the_recording(bags, tmp_path):
    path = bags.write(tmp_path, [("/camera", t, bags.image(0, PICTURE)) for t in (7, 8)])
    np.testing.assert_allclose(open_rosbag(path).times_s, [7, 8])


def test_without_odometry_motion_is_unknown_and_that_is_said(bags, tmp_path):
    path = bags.write(tmp_path, [("/camera", t, bags.image(t, PICTURE)) for t in (1, 2)])
    drive = open_drive(str(path), None, tmp_path / "out")
    assert drive.motions == [None, None]
    assert "no odometry" in drive.remarks[0]


def test_a_topic_is_chosen_where_there_are_several(bags, tmp_path):
    left, right = bags.image(1, PICTURE), bags.image(1, 255 - PICTURE)
    path = bags.write(tmp_path, [("/left", 1, left), ("/right", 1, right)])
    with pytest.raises(UserError, match="image_topic= is missing: there are /left, /right"):
        open_rosbag(path)
    np.testing.assert_array_equal(seen(open_rosbag(path, image_topic="/right")), [255 - PICTURE])
    with pytest.raises(UserError, match="image_topic=/middle has no messages of type"):
        open_rosbag(path, image_topic="/middle")
    with pytest.raises(UserError, match="odometry_topic=/odom has no messages of type"):
        open_rosbag(path, image_topic="/left", odometry_topic="/odom")


def test_a_bag_without_images_says_what_it_has(bags, tmp_path):
    path = bags.write(tmp_path, [("/odom", 1, bags.odometry(1, 0.0, 0.0))])
    with pytest.raises(UserError, match="has no images\nIts topics: /odom"):
        open_rosbag(path)


def test_a_damaged_bag_is_one_message(tmp_path):
    (tmp_path / "drive.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\0" * 100)
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    for name in ("drive.bag", "drive"):
        with pytest.raises(UserError, match="cannot be read as a ROS bag"):
            open_rosbag(tmp_path / name)


def test_topics_are_of_bags_alone(tmp_path):
    Image.fromarray(PICTURE).save(tmp_path / "1.png")
    with pytest.raises(UserError, match="image_topic=/camera is for a ROS bag"):
        open_drive(str(tmp_path), None, tmp_path / "out", image_topic="/camera")


@pytest.mark.parametrize(
    ("turned", "usable"),
    [
        ((0, 0, 0, 0), False), ((np.nan, 0, 0, 1), False), ((0, 0, 0, np.nan), False), ((np.inf, 0, 0, 1), False),
        ((0, 0, 0, 2), False), ((0, 0, 0, 0.5), False), ((0, 0, 0.7, 0.2), False), ((1e-9, 0, 0, 0), False),
        ((0, 0, 0, 1), True), ((0, 0, 0, -1), True), ((0, 0, 0.6, 0.8), True), ((0, 0, 0, 1.005), True),
    ],
)  # fmt: skip
@pytest.mark.parametrize("all_of_them", [True, False])
def test_orientations_that_are_none_are_left_out_and_said(bags, tmp_path, turned, usable, all_of_them):
    messages = [("/camera", t, bags.image(t, PICTURE)) for t in (1, 2, 3, 4)]
    for t in (1, 2, 3, 4):
        odometry = bags.odometry(t, x=2.0 * t, heading=0.0)
        if all_of_them or t == 2:
            quaternion = dict(zip("xyzw", map(float, turned), strict=True))
            odometry.pose.pose.orientation = bags.new("geometry_msgs/msg/Quaternion", **quaternion)
        messages.append(("/odom", t, odometry))
    path = bags.write(tmp_path, sorted(messages, key=lambda message: message[1]))
    drive = open_drive(str(path), None, tmp_path / "out")
    if usable:
        assert drive.remarks == []
    else:
        count = "4 of 4" if all_of_them else "1 of 4"
        assert (
            f"odometry of /odom: {count} poses cannot be used, such as number {1 if all_of_them else 2}"
            in drive.remarks[0]
        )
    if usable or not all_of_them:
        assert [round(float(np.hypot(*motion[:2])), 6) for motion in drive.motions[1:]] == [2.0] * 3
    else:
        assert drive.motions == [None] * 4
        with pytest.raises(UserError, match=r"odometry_topic=/odom: odometry of /odom: 4 of 4 poses cannot be used"):
            open_drive(str(path), None, tmp_path / "out", odometry_topic="/odom")


@pytest.mark.parametrize(
    ("files", "given", "said"),
    [
        (
            {"drive.bag": b"a few words"},
            "drive.bag",
            r"begins with b'a few words', but a ROS 1 bag begins with b'#ROSBAG V2.0'",
        ),
        ({"drive.bag": b""}, "drive.bag", r"It begins with b''"),
        ({"drive.bag": b"#ROSBAG V2.0\n"}, "drive.bag", r"rosbag reindex"),
        ({"drive/metadata.yaml": b"a: 1"}, "drive", r"a folder with metadata.yaml and a .db3 or .mcap file"),
        ({"drive/metadata.yaml": b"a: [", "drive/a.db3": b""}, "drive", r"ros2 bag reindex .*drive"),
    ],
)
def test_what_is_no_bag_is_told_what_one_is(tmp_path, files, given, said):
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=rf"{given} cannot be read as a ROS bag.*\n.*{said}"):
        open_rosbag(tmp_path / given)


def test_a_bag_that_does_not_exist_says_so(tmp_path):
    (tmp_path / "drive.bag").write_bytes(b"")
    with pytest.raises(UserError, match=r"input=.*drives\.bag does not exist; did you mean .*drive\.bag\?"):
        open_drive(str(tmp_path / "drives.bag"), None, tmp_path / "out")
