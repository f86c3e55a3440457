"""ROS bags of both versions, written by the package ``rosbags``, read as drives."""

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from made_up_bags import Bags
from PIL import Image
from rosbags.rosbag2 import StoragePlugin

from sextant.chapters.localization.data.own_drive import NO_ODOMETRY, find_images, open_drive
from sextant.chapters.localization.data.ros_messages import camera_of
from sextant.chapters.localization.data.rosbag import bag_summary, is_rosbag, open_rosbag
from sextant.chapters.localization.locating import locate_frames
from sextant.errors import UserError
from sextant.tools.inspection.seen import found_files

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
    path = bags.write(tmp_path, [("/camera", 1, bags.image(1, PICTURE, encoding="32FC1"))])
    (frame,) = open_rosbag(path).read(SIZE)
    assert "encoding 32FC1 is not one of mono8" in frame.problem


def pictures(bags, path, *messages):
    """The images of a bag of these messages, in colour."""
    bag = open_rosbag(bags.write(path, [("/camera", t + 1, message) for t, message in enumerate(messages)]))
    return list(bag.read((8, 12, 3)))


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_give_the_colours_that_they_were_made_of(bags, tmp_path, pattern):
    colours = np.array([200, 90, 30], np.uint8)  # flat, so that interpolation cannot change it
    mosaic = np.tile(colours[["rgb".index(letter) for letter in pattern]].reshape(2, 2), (4, 6))
    rows = np.pad(mosaic, [(0, 0), (0, 4)])  # padded
    (frame,) = pictures(bags, tmp_path, bags.raw_image(1, rows.tobytes(), 8, 12, f"bayer_{pattern}8", 16))
    np.testing.assert_array_equal(frame.image, np.broadcast_to(colours, (8, 12, 3)))


def yuv_of(rgb):
    """BT.601 in video range, of one colour."""
    r, g, b = (float(value) for value in rgb)
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    return round(y), round(128 - 0.148 * r - 0.291 * g + 0.439 * b), round(128 + 0.439 * r - 0.368 * g - 0.071 * b)


@pytest.mark.parametrize("encoding", ["uyvy", "yuv422", "yuyv", "yuv422_yuy2", "nv12", "nv21"])
def test_yuv_gives_the_colours_that_it_was_made_of(bags, tmp_path, encoding):
    left, right = (200, 90, 30), (20, 60, 220)  # two halves: bytes in a wrong order would exchange colours
    halves = [yuv_of(left), yuv_of(right)]
    if encoding.startswith("nv"):
        luma = np.tile(np.repeat([half[0] for half in halves], 6), (8, 1))
        order = (1, 2) if encoding == "nv12" else (2, 1)
        chroma = np.tile(np.concatenate([np.tile([half[k] for k in order], 3) for half in halves]), (4, 1))
        rows = np.concatenate([luma, chroma])
    else:
        pairs = [(u, y, v, y) if encoding in ("uyvy", "yuv422") else (y, u, y, v) for y, u, v in halves]
        rows = np.tile(np.concatenate([np.tile(pair, 3) for pair in pairs]), (8, 1))
    rows = np.pad(rows.astype(np.uint8), [(0, 0), (0, 4)])
    (frame,) = pictures(bags, tmp_path, bags.raw_image(1, rows.tobytes(), 8, 12, encoding, rows.shape[1]))
    np.testing.assert_allclose(frame.image[:, :6].astype(int) - left, 0, atol=3)
    np.testing.assert_allclose(frame.image[:, 6:].astype(int) - right, 0, atol=3)


@pytest.mark.parametrize("is_bigendian", [0, 1])
def test_sixteen_bits_are_scaled_by_one_level_for_the_whole_recording(bags, tmp_path, is_bigendian):
    order = ">u2" if is_bigendian else "<u2"
    day, night = np.full((8, 12), 4000), np.full((8, 12), 1000)  # of 12 bits
    messages = [
        bags.raw_image(t, values.astype(order).tobytes(), 8, 12, "mono16", 24, is_bigendian)
        for t, values in enumerate([day, night], 1)
    ]
    bright, dark = (frame.image for frame in pictures(bags, tmp_path, *messages))
    assert (bright == 4000 >> 4).all()
    assert (dark == 1000 >> 4).all()  # darker than by day, whatever its own largest value


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (("bayer_rggb8", 10, 80), "80 bytes in rows of 10 do not make 12x8 pixels of bayer_rggb8"),
        (("nv12", 12, 96), "96 bytes in rows of 12 do not make 12x8 pixels of nv12"),
        (("mono16", 12, 96), "96 bytes in rows of 12 do not make 12x8 pixels of mono16"),
    ],
)
def test_data_that_do_not_fit_the_size_are_named(bags, tmp_path, fields, said):
    encoding, step, count = fields
    (frame,) = pictures(bags, tmp_path, bags.raw_image(1, bytes(count), 8, 12, encoding, step))
    assert said in frame.problem


def test_odd_sides_do_not_go_with_patterns_of_two_pixels(bags, tmp_path):
    (frame,) = pictures(bags, tmp_path, bags.raw_image(1, bytes(7 * 12), 7, 12, "bayer_rggb8", 12))
    assert "12x7 pixels do not go with bayer_rggb8, whose sides are even" in frame.problem


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_the_file_of_a_ros_2_bag_is_read_without_its_folder(tmp_path, storage):
    bags = Bags(2)
    messages = [("/camera", t, bags.image(t, PICTURE)) for t in (1, 2)]
    messages += [("/odom", t, bags.odometry(t, x=2.0 * t, heading=0.0)) for t in (1, 2)]
    folder = bags.write(tmp_path, sorted(messages, key=lambda message: message[1]), storage)
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    bare = file.rename(tmp_path / f"bare{file.suffix}")
    drive = open_drive(str(bare), None, tmp_path / "out")
    np.testing.assert_array_equal([frame.image for frame in drive.frames.read(SIZE)], [PICTURE] * 2)
    np.testing.assert_allclose(drive.motions[1], [2, 0, 0], atol=1e-9)
    assert "/camera (2 images, 2 Hz)" in bag_summary(bare)


def test_inspect_lists_a_bag_once_and_files_that_are_alone(tmp_path):
    bags = Bags(2)
    folder = bags.write(tmp_path, [("/camera", 1, bags.image(1, PICTURE))], StoragePlugin.MCAP)
    (file,) = folder.glob("*.mcap")
    shutil.copy(file, tmp_path / "alone.mcap")
    assert found_files(tmp_path).recordings == (Path("alone.mcap"), Path("drive"))


MATRIX = [[500.0, 0, 5.5], [0, 510, 3.5], [0, 0, 1]]
BENT = (-0.3, 0.1, 0.001, -0.002, 0.02)


def test_the_camera_is_that_of_camera_info_beside_the_images(bags, tmp_path):
    other = [[9.0, 0, 1], [0, 9, 1], [0, 0, 1]]
    messages = [
        ("/left/image_raw", 1, bags.image(1, PICTURE)),
        ("/left/camera_info", 1, bags.camera(1, 12, 8, MATRIX, BENT, binning=2)),
        ("/right/camera_info", 1, bags.camera(1, 12, 8, other)),
    ]
    path = bags.write(tmp_path, messages)
    bag = open_rosbag(path)
    # a pixel of the binned image covers two: their common centre is that of the first pixel and a half
    assert bag.camera.lens.opencv == pytest.approx((250, 255, 2.5, 1.5, *BENT))
    assert (bag.camera.lens.width, bag.camera.lens.height) == (6, 4)
    remarks = open_drive(str(path), None, tmp_path / "out").remarks
    assert remarks == [NO_ODOMETRY, f"camera of /left/image_raw, whose images are used as they are: {bag.camera}"]
    assert "camera of /left/image_raw: 6x4, plumb_bob: fx 250, fy 255" in bag_summary(path)


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant"])
def test_a_straightened_image_shows_each_ray_where_a_pinhole_does(model):
    height, width = 60, 80
    matrix = np.array([[50.0, 0, 39.5], [0, 50, 29.5], [0, 0, 1]])
    bent = {
        "plumb_bob": (-0.2, 0.05, 0.002, -0.001, 0.01),
        "rational_polynomial": (-0.2, 0.05, 0.002, -0.001, 0.01, 0.02, 0.0, 0.0),
        "equidistant": (-0.05, 0.01, 0.0, 0.0),
    }[model]
    camera = camera_of(Bags(2).camera(1, width, height, matrix, bent, model), "/camera/image_raw")
    x, y = 0.45, -0.3  # a ray (x, y, 1), imaged by the equations of the model
    square, angle = x * x + y * y, np.arctan(np.hypot(x, y))
    if model == "equidistant":
        factor = angle * (1 + bent[0] * angle**2 + bent[1] * angle**4) / np.tan(angle)
        u, v = factor * x, factor * y
    else:
        k1, k2, p1, p2, k3, *below = (*bent, 0.0, 0.0, 0.0)[:8]
        factor = (1 + k1 * square + k2 * square**2 + k3 * square**3) / (1 + below[0] * square)
        u = factor * x + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        v = factor * y + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    at = np.array([50 * u + 39.5, 50 * v + 29.5])
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    spot = 255 * np.exp(-((columns - at[0]) ** 2 + (rows - at[1]) ** 2) / 8)
    straight = camera.straight(np.repeat(spot[..., None], 3, 2).astype(np.uint8), "spot")[..., 0].astype(float)
    found = [(straight * each).sum() / straight.sum() for each in (columns, rows)]
    assert found == pytest.approx([50 * x + 39.5, 50 * y + 29.5], abs=0.3)
    assert np.linalg.norm(at - [50 * x + 39.5, 50 * y + 29.5]) > 1  # or the test would show nothing


def test_rectified_images_have_the_camera_of_the_projection_and_uncalibrated_ones_none():
    bags, projection = Bags(2), [[480.0, 0, 6, 0], [0, 480, 4, 0], [0, 0, 1, 0]]
    given = bags.camera(1, 12, 8, MATRIX, BENT, projection=projection)
    for part in ("image_rect", "image_rect_color", "image_rect_raw", "rectified/image", "image_rect/compressed"):
        assert camera_of(given, f"/left/{part}").lens.opencv == (480, 480, 6, 4, 0, 0, 0, 0)
    for topic in ("/left/image_raw", "/camera/direct/image_raw", "/cam/unrectified/image", "/rect/left/image_raw"):
        assert camera_of(given, topic).lens.opencv == pytest.approx((500, 510, 5.5, 3.5, *BENT))
    assert camera_of(bags.camera(1, 12, 8, np.zeros(9)), "/left/image_raw") is None


def test_a_distortion_model_that_is_not_known_is_named(bags, tmp_path):
    messages = [
        ("/left/image_raw", 1, bags.image(1, PICTURE)),
        ("/left/camera_info", 1, bags.camera(1, 6, 4, MATRIX, (0.1, 0.2, 0.3), "omnidirectional")),
    ]
    bag = open_rosbag(bags.write(tmp_path, messages))
    assert bag.camera is None
    assert bag.camera_problem.startswith("camera_info of /left/image_raw: distortion_model='omnidirectional' with 3")
    with pytest.raises(UserError, match="omnidirectional"):  # where a camera is wanted
        locate_frames(None, bag, None, tmp_path, [], lambda done, total: None)


def test_a_camera_that_cannot_be_of_its_images_is_not_told_as_the_users(bags, tmp_path):
    messages = [
        ("/left/image_raw", 1, bags.image(1, PICTURE)),
        ("/left/camera_info", 1, bags.camera(1, 6, 4, MATRIX)),
    ]
    bag = open_rosbag(bags.write(tmp_path, messages))
    with pytest.raises(UserError, match=r"^camera_info of the bag: 1 camera cannot be used\n  .*: fx,fy,cx,cy=500,510"):
        locate_frames(None, bag, None, tmp_path, [], lambda done, total: None)


def test_an_image_of_another_shape_than_its_camera_is_named():
    camera = camera_of(Bags(1).camera(1, 12, 8, MATRIX, BENT), "/left/image_raw")
    with pytest.raises(UserError, match="image 3 has 12x12 pixels, but its camera is of 12x8"):
        camera.straight(np.zeros((12, 12, 3), np.uint8), "image 3")


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


def test_odometry_is_chosen_only_where_it_is_read(bags, tmp_path):
    poses = [(f"/odom_{k}", t, bags.odometry(t, 1.0 * t, 0.0)) for t in (1, 2) for k in "ab"]
    images = [("/camera", t, bags.image(t, PICTURE)) for t in (1, 2)]
    path = bags.write(tmp_path, sorted([*poses, *images], key=lambda message: message[1]))
    with pytest.raises(UserError, match="odometry_topic= is missing: there are /odom_a, /odom_b"):
        open_drive(str(path), None, tmp_path / "out")
    bag = find_images(str(path), tmp_path / "out", 1, with_odometry=False)
    assert (len(bag), bag.odometry, bag.remarks) == (2, None, ())
    (tmp_path / "own.tum").write_text("1 0 0 0 0 0 0 1\n2 3 0 0 0 0 0 1\n")
    drive = open_drive(str(path), tmp_path / "own.tum", tmp_path / "out")
    np.testing.assert_allclose(np.hypot(*drive.motions[1][:2]), 3.0)
    with pytest.raises(UserError, match="odometry_topic=/odom has no messages of type"):
        open_drive(str(path), tmp_path / "own.tum", tmp_path / "out", odometry_topic="/odom")


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
        ({"drive.mcap": b"a few words"}, "drive.mcap", r"begins with b'a few wo', but an MCAP file begins with"),
        ({"drive.mcap": b"\x89MCAP0\r\n"}, "drive.mcap", r"must be written by ROS 2, in CDR"),
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
