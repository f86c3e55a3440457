"""Folders as people have them, and folders that are broken, each with what is said of it."""

import json
import os
import shutil
import struct
from functools import partial

import cv2
import numpy as np
from data.localization.test_pose_folder import N, csv, kitti, names
from data.photos.pictures import scene
from data.places.gps_pictures import add_gps
from data.places.place_pictures import write_pictures
from data.reconstructions.written import WRITERS, some_poses
from made_up_bags import Bags
from PIL import Image

from sextant.chapters.localization.data.pose_formats import write_tum

MAKE, MODEL, EXIF, GPS, TAKEN, NOTE, F35 = 0x010F, 0x0110, 0x8769, 0x8825, 0x9003, 0x927C, 0xA405
LINE = np.column_stack([np.arange(N), np.zeros(N), np.zeros(N)]).astype(float)


def photo(path, seed=0, width=320, height=240, camera=None, taken=None, gps=None, note=None, focal=28):
    """A small photo with as much EXIF as is asked for."""
    path.parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    if camera:
        exif[MAKE], exif[MODEL] = camera
        exif.get_ifd(EXIF)[F35] = focal
    if taken:
        exif.get_ifd(EXIF)[TAKEN] = f"2024:05:01 10:{taken // 60:02d}:{taken % 60:02d}"
    if note:
        exif.get_ifd(EXIF)[NOTE] = note
    if gps:
        exif.get_ifd(GPS).update(gps)
    pixels = np.roll(scene(width, height), 7 * seed, axis=0)
    Image.fromarray(pixels).save(path, **({"exif": exif} if path.suffix == ".jpg" else {}))
    return path


def panorama(path, seed=0):
    angle = np.linspace(0, 2 * np.pi, 512, endpoint=False)[None, :, None]
    noise = np.random.default_rng(seed).normal(0, 3, (256, 512, 3))
    around = 120 + 50 * np.sin(angle) + 30 * np.cos(3 * angle) + noise
    around[:20] = 200
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(around.astype(np.uint8)).save(path)


def photos(folder, count=3, **options):
    for k in range(count):
        photo(folder / f"{k}.jpg", k, **options)


def spatial(poses):
    found = np.tile(np.eye(4), (len(poses), 1, 1))
    found[:, :3] = np.loadtxt(kitti(poses).splitlines()).reshape(-1, 3, 4)
    return found


def drives(folder, form):
    """Two drives of one format of poses."""
    for k, drive in enumerate(("map", "evening run")):
        inside = folder / drive
        write_pictures(inside / "images" if form == "colmap" else inside, names(), first=20 * k)
        if form == "csv":
            (inside / "poses.csv").write_text(csv(LINE))
        elif form == "tum":
            write_tum(inside / "poses.txt", 1000.25 + np.arange(N), LINE)
        elif form == "kitti":
            (inside / "poses.txt").write_text(kitti(LINE))
        elif form == "gps":
            for name, (x, y, _) in zip(names(), 4 * LINE, strict=True):
                add_gps(inside / name, x, y)
        else:
            name, write = WRITERS[form]
            (inside / "sparse/0").mkdir(parents=True)
            write(inside / ("sparse/0" if form == "colmap" else "") / name, names(), spatial(LINE))


def _apart(folder):
    """Two drives by GPS in two towns."""
    drives(folder, "gps")
    for name in names():
        add_gps(folder / "map" / name, 5000, 0)


def _placed_rides(folder):
    for ride in ("day", "night"):
        write_pictures(folder / ride, names(), first=ord(ride[0]))
        for k, name in enumerate(names()):
            add_gps(folder / ride / name, 20 * k, 0, 90)


def _copies(folder):
    """As ns-process-data leaves them, which knows nothing of the smaller ones."""
    drives(folder, "colmap")
    for drive in ("map", "evening run"):
        write_pictures(folder / drive / "images_2", names(), first=50)


def apple_note(tag):
    return b"Apple iOS\0\0\1MM" + struct.pack(">H", 1) + struct.pack(">HHII", tag, 10, 3, 0) + b"\0" * 24


def _mixed(folder):
    photos(folder, camera=("Apple", "iPhone 12"))
    photo(folder / "z.jpg", 9, camera=("Canon", "Canon EOS 5D"), width=300)


def _small_ones_too(folder):
    photos(folder)
    photo(folder / "small.jpg", 3, width=160, height=120)
    photo(folder / "icon.jpg", 4, width=24, height=24)


def _among(folder):
    photos(folder)
    panorama(folder / "hall.png")


def _jumps(folder):
    for k, second in enumerate((0, 1, 2, 3, 120, 121)):
        photo(folder / f"{k}.jpg", k, taken=second + 1)


def _jumping_names(folder):
    write_pictures(folder, [f"{1000.5 + k + 60 * (k > 5):.2f}.png" for k in range(10)])


def _backwards(folder):
    for k, second in enumerate((5, 4, 6, 7)):
        photo(folder / f"{k}.jpg", k, taken=second)


def _poses_alone(folder):
    write_tum(folder / "poses.txt", np.arange(N) / 2, LINE)


def _fewer_rows(folder):
    write_pictures(folder, names())
    (folder / "poses.csv").write_text("\n".join(csv(LINE).splitlines()[:-2]))


def _more_rows(folder):
    write_pictures(folder, names()[:3])
    (folder / "poses.csv").write_text(csv(LINE))


def _other_count(folder):
    write_pictures(folder, [f"{k}.png" for k in range(N - 1)])
    (folder / "poses.txt").write_text(kitti(LINE))


def _clocks(folder):
    write_pictures(folder, names())
    write_tum(folder / "poses.txt", np.arange(N), LINE)


def _nan_tum(folder):
    (folder / "poses.txt").write_text("0 nan nan nan nan nan nan nan\n1 0 0 0 0 0 0 1\n")


def _nan_kitti(folder):
    (folder / "poses.txt").write_text("nan " * 12 + "\n")


def _nan_csv(folder):
    write_pictures(folder, ["a.png"])
    (folder / "poses.csv").write_text("file,x,y,heading\na.png,nan,0,0\n")


def _nan_json(folder):
    frame = {"file_path": "a.png", "transform_matrix": np.full((4, 4), np.nan).tolist()}
    (folder / "transforms.json").write_text(json.dumps({"frames": [frame]}))


def _latin(folder):
    (folder / "poses.csv").write_bytes(b"file,x,y\ngr\xf6\xdfe.png,1,2\n")


def _deep(folder):
    (folder / "reconstruction.json").write_text("[" * 100_000)


def _cut_colmap(folder):
    path = WRITERS["colmap"][1](folder / "images.bin", names(), some_poses(N))
    path.write_bytes(path.read_bytes()[:200])


def _no_ground(folder):
    for k, drive in enumerate(("map", "run")):
        write_pictures(folder / drive, names(), first=20 * k)
        WRITERS["opensfm"][1](folder / drive / "reconstruction.json", names(), some_poses(N))


def _walk(folder):
    """A drive with poses, one without, and a video."""
    drives(folder, "csv")
    (folder / "map").rename(folder / "summer")
    shutil.rmtree(folder / "evening run")
    write_pictures(folder / "winter" / "images", names(), first=30)
    _video(folder)
    (folder / "walk.avi").rename(folder / "again.avi")


def _posed(folder):
    """Photos with six-dimensional poses, and others beside them."""
    for k, drive in enumerate(("office", "photos")):
        write_pictures(folder / drive, names(), first=20 * k)
    rows = [f"{name},{k},0,0,1,0,0,0" for k, name in enumerate(names())]
    (folder / "office" / "poses.csv").write_text("\n".join(["file,x,y,z,qw,qx,qy,qz", *rows]))


def _with_a_thumbnail(folder):
    photos(folder)
    Image.new("RGB", (40, 40)).save(folder / "thumbnail.jpg")


def _one_drive(folder):
    write_pictures(folder, names())
    WRITERS["nerfstudio"][1](folder / "transforms.json", names(), some_poses(N))


def _broken_files(folder):
    whole = photo(folder / "good.jpg").read_bytes()
    (folder / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "cut.png").write_bytes(photo(folder / "other.png", 1).read_bytes()[:-20])
    (folder / "empty.jpg").touch()
    (folder / "words.jpg").write_text("no picture")
    (folder / "phone.heic").write_bytes(b"\0\0\0\x18ftypheic")
    (folder / "raw.CR2").write_bytes(b"II*\0")


def _links(folder):
    photos(folder / "day")
    (folder / "day" / "round").symlink_to(folder, target_is_directory=True)
    (folder / "gone.jpg").symlink_to(folder / "nowhere.jpg")
    (folder / "self.jpg").symlink_to(folder / "self.jpg")


def _pipes(folder):
    photos(folder)
    for name in ("pipe.jpg", "pipe.txt", "pipe.csv", "pipe.mp4"):
        os.mkfifo(folder / name)


def _twice(folder):
    photos(folder)
    (folder / "copy.jpg").write_bytes((folder / "0.jpg").read_bytes())
    photo(folder / "1.png", 1)


def _broken_video(folder):
    (folder / "walk.mp4").write_bytes(np.random.default_rng(0).bytes(5000))
    (folder / "empty.avi").touch()


def _video(folder, size=(96, 64)):
    video = cv2.VideoWriter(str(folder / "walk.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, size)
    for k in range(20):
        video.write(cv2.resize(np.roll(scene(), k, axis=1), size))
    video.release()


def write_bag(folder, version):
    bags = Bags(version)
    return bags.write(folder, [("/odom", 1, bags.odometry(1, 0.0, 0.0))])


def _bags(folder):
    """One of each version; and some that are empty, of another kind, cut or a link to nothing."""
    for version in (1, 2):
        write_bag(folder, version)
    (folder / "empty.bag").touch()
    (folder / "words.mcap").write_text("hello")
    (folder / "cut.bag").write_bytes(b"#ROSBAG V2.0\n")
    (folder / "gone.db3").symlink_to("nowhere")
    (folder / "second").mkdir()
    (folder / "second" / "metadata.yaml").touch()


def _bomb(folder):
    """Headers of pictures that nobody could decode."""
    for name, width in (("wide.ppm", 60_000), ("square.ppm", 30_000)):
        (folder / name).write_bytes(b"P6 %d 30000 255\n" % width + b"\0" * 1000)


def _trajectories(folder):
    for name, shift in (("estimate", 0.1), ("groundtruth", 0.0)):
        write_tum(folder / f"{name}.txt", np.arange(N) / 2, LINE + shift)


def _utm(folder):
    for name in ("database", "queries"):
        write_pictures(folder / name, [f"@{500000 + k}@4100000@30@S@@@@@@@@@@{k}@.png" for k in range(4)])


def _rides(folder):
    for k, name in enumerate(("night", "reference")):
        write_pictures(folder / name, [f"{i}.png" for i in range(6)], first=20 * k)


def _classes(folder):
    for k, name in enumerate(("cat", "dog")):
        write_pictures(folder / name, [f"{name}{i}.png" for i in range(6)], first=20 * k)


def _numbered_classes(folder):
    for k in range(3):
        write_pictures(folder / f"digit {k}", [f"{i:03d}.png" for i in range(6)], first=20 * k)


def classes(folder, count, images, name="{c}_{k}", seconds=None):
    """Folders of some images each, in which names, or times by EXIF, may be those of a video."""
    for k in range(count):
        for i in range(images):
            taken = None if seconds is None else 1 + k * 60 + round(i * seconds)
            photo(
                folder / f"kind{k:02d}" / f"{name.format(c=k, k=i, t=100 * k + i)}.jpg", 20 * k + i, 48, 36, taken=taken
            )


def _with_odometry(folder, name, odometry, head="file,x,y,theta"):
    """A map, and a drive without poses beside or around a table of odometry."""
    _walk(folder)
    (folder / "winter").mkdir(exist_ok=True)
    rows = [",".join([each, *map(str, row)]) for each, row in zip(names(), odometry, strict=True)]
    (folder / name).write_text("\n".join([head, *rows]))


def spaced(folder, metres):
    """Two drives with a table, of images some metres apart."""
    drives(folder, "csv")
    for drive in ("map", "evening run"):
        (folder / drive / "poses.csv").write_text(csv(LINE * [metres, 1, 1]))


def _split_classes(folder):
    for k, split in enumerate(("train", "test")):
        _classes(folder / split)
        write_pictures(folder / split / "cat", ["more.png"], first=99 + k)


def _known(folder):
    photos(folder)
    (folder / "known.csv").write_text("file,f_px\n0.jpg,300\n1.jpg,300\n2.jpg,300\n")


def _published(folder):
    path = folder / "MNIST" / "raw" / "train-images-idx3-ubyte"
    path.parent.mkdir(parents=True)
    path.touch()


def _tags(folder):
    gps = {1: "S", 2: (33.0, 30.0, 0.0), 3: "E", 4: (151.0, 0.0, 36.0), 5: 1, 6: 12.0}
    photo(folder / "a.jpg", 0, camera=("Apple", "iPhone 12"), gps=gps, note=apple_note(8))
    photo(
        folder / "b.jpg",
        1,
        camera=("Apple", "iPhone 12"),
        gps={1: "N", 2: (95.0, 0.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0)},
        note=apple_note(9),
    )


#: what makes a folder, and what is said of it: of the summary, the remarks, what cannot be read, or the suggestions
FOLDERS = {
    "empty": (lambda folder: None, ["there is nothing here"]),
    "words alone": (lambda folder: (folder / "notes.md").write_text("hello"), ["other files: 1 .md"]),
    "hidden": (lambda folder: photos(folder / ".trash"), ["there is nothing here"]),
    "one camera": (
        lambda folder: photos(folder, camera=("Apple", "iPhone 12")),
        ["3 photos of one camera (Apple iPhone 12)", "camera=one", "focal_prior=exif", "Apple iPhone 12, f 259 px"],
    ),
    "no EXIF": (photos, ["if one camera with one zoom took them all", "camera=one"]),
    "mixed cameras": (_mixed, ["4 photos of 2 cameras or settings of a lens, each", "the photos of one at a time"]),
    "small photos too": (_small_ones_too, ["4 photos of 2 sizes, each by itself", "photos of 2 sizes: camera=one"]),
    "a panorama among photos": (_among, ["1 panorama of 360 degrees among 3 photos, such as hall.png"]),
    "panoramas": (
        lambda folder: [panorama(folder / f"{k}.png", k) for k in range(4)],
        ["4 panoramas, from which photos of known cameras are cut", "dataset=panorama_folder"],
    ),
    "a jump in time": (_jumps, ["1 jumps in time by EXIF, the first of 117.0 s before 4.jpg", "0:02:01 by EXIF"]),
    "names that jump": (_jumping_names, ["1 jumps in time by names, the first of 61.0 s before 1066.50.png"]),
    "names out of order": (
        _backwards, ["the order of names differs from the order of time by EXIF at 1 places, the first 1.jpg"]
    ),
    "poses without images": (_poses_alone, ["poses.txt (tum): 8 poses"]),
    "images without poses": (_fewer_rows, ["of 6 of 8 images", "2 images in . have no pose"]),
    "rows without images": (_more_rows, ["5 poses have no image"]),
    "another number of poses": (_other_count, ["8 poses for 7 images, and no times by which to match them"]),
    "two clocks": (_clocks, ["no pose is near in time to an image: do both use the same clock?"]),
    "nan in TUM": (_nan_tum, ["poses.txt (tum): 1 line cannot be used"]),
    "nan in KITTI": (_nan_kitti, ["poses.txt (kitti)", "12 finite numbers are expected"]),
    "nan in a table": (_nan_csv, ["x='nan' of a.png must be a finite number"]),
    "nan in JSON": (_nan_json, ["frame 1: its file_path or its 4x4 transform_matrix is missing or not a pose"]),
    "a table in Latin-1": (_latin, ["poses.csv (csv): cannot be read: byte"]),
    "JSON without end": (_deep, ["reconstruction.json (opensfm): is not JSON"]),
    "a model that was cut": (_cut_colmap, ["images.bin (colmap): is truncated, or not a COLMAP file (200 bytes)"]),
    "a world without ground": (_no_ground, ["the ground is not a plane of two world axes"]),
    "one drive alone": (_one_drive, ["need a second one through the same places"]),
    "a drive without poses": (
        _walk, ["/winter/images map=", "/summer output=walk/winter/images", "/summer every=10 output=walk/again"]
    ),
    "broken files": (
        _broken_files,
        ["cut.jpg: is truncated", "cut.png: is truncated", "empty.jpg: is empty (0 bytes)",
         "words.jpg: cannot be decoded (10 bytes): it is text", "phone.heic: is HEIC by its content",
         "raw.CR2: is a raw file (.cr2)", "images: 2 "],
    ),
    "links in a circle": (_links, ["day/round is a link to a folder", "gone.jpg: is a broken link", "self.jpg: "]),
    "pipes": (_pipes, ["pipe.jpg: is not a file", "pipe.csv: is not a file", "3 photos"]),
    "the same twice": (_twice, ["1 image is a duplicate of another, such as copy.jpg = 0.jpg", "1.jpg and 1.png"]),
    "videos that do not decode": (_broken_video, ["walk.mp4: cannot be opened as a video", "empty.avi: is empty"]),
    "a video": (_video, ["walk.avi: 20 frames of 96x64, 2.0 s", "every=10"]),
    "posed photos": (_posed, ["sextant locate map=", "/office input=", "/photos output=located/photos\n"]),
    "a thumbnail among photos": (_with_a_thumbnail, ["output=calibrated\n"]),
    "a video to calibrate": (
        partial(_video, size=(320, 240)),
        ["walk.avi: 20 frames of 320x240", "sextant predict ", "walk.avi output=calibrated/walk\n"],
    ),
    "recordings": (
        _bags,
        ["recordings: drive: 0.0 s", "\ndrive.bag: 0.0 s", "/drive.bag every=10 output=localization/drive.bag",
         "cannot be read: 5\n", "empty.bag: is empty (0 bytes)", "words.mcap: is not an MCAP file: it begins with",
         "cut.bag: cannot be read as a ROS bag: ", "gone.db3: is a link", "second: cannot be read as a ROS bag: "],
    ),
    "too large to decode": (_bomb, ["60000x30000 (1)", "30000x30000 (1)"]),
    "two trajectories": (_trajectories, ["sextant trajectory ", "groundtruth.txt ", "1 pairs of files"]),
    "names with UTM": (_utm, ["2 folders, database as the map; their names state", "places=utm"]),
    "two rides": (_rides, ["2 folders, reference as the map; equal names", "places=name"]),
    "classes": (_classes, ["2 folders of images, cat to dog: if each is a class", "dataset=image_folder"]),
    "classes numbered alike": (
        _numbered_classes, ["equal names are assumed to be equal places", "3 folders of images, digit 0 to digit 2: if"]
    ),
    "classes with splits": (_split_classes, ["2 folders of images, cat to dog"]),
    "classes of few": (lambda folder: classes(folder, 3, 5), ["3 folders of images", "dataset=image_folder"]),
    "twelve classes": (lambda folder: classes(folder, 12, 12), ["12 folders of images", "dataset=image_folder"]),
    "photos of classes, minutes apart": (
        lambda folder: classes(folder, 2, 6, seconds=9), ["2 folders of images", "dataset=image_folder"]
    ),
    "copies of one second": (lambda folder: classes(folder, 2, 6, seconds=0), ["dataset=image_folder"]),
    "drives a metre apart": (
        lambda folder: spaced(folder, 1), ["images are 1 m apart, so 5 m counts as correct", " dataset.protocol=town"]
    ),
    "drives 20 m apart": (lambda folder: spaced(folder, 20), [" dataset.protocol=town", "few poses can be so close"]),
    "odometry beside": (
        lambda folder: _with_odometry(folder, "winter/odometry.csv", LINE), ["/winter/odometry.csv output=walk/winter"]
    ),
    "odometry among": (
        lambda folder: _with_odometry(folder, "winter/images/Odom.csv", LINE), ["/winter/images/Odom.csv output=walk"]
    ),
    "known cameras": (_known, ["ground truth beside the photos: known.csv", "sextant benchmark calibration"]),
    "a published set": (_published, ["sextant train dataset=mnist paths.data="]),
    "tags": (_tags, ["GPS: 1 image over 0 x 0 m, 0 with a direction", "gravity: 1 by accelerometer (Apple)"]),
    "drives with tables": (lambda folder: drives(folder, "csv"), ["'dataset.test={evening_run: \"evening run\"}'"]),
    "drives in TUM": (lambda folder: drives(folder, "tum"), ["dataset.poses=tum", "dataset.ahead=x"]),
    "drives in KITTI": (lambda folder: drives(folder, "kitti"), ["dataset.poses=kitti dataset.plane=xz"]),
    "drives of COLMAP": (
        lambda folder: drives(folder, "colmap"),
        ["dataset.map=map/images", "dataset.poses=colmap dataset.pose_file=../sparse/0/images.bin dataset.plane=xz"],
    ),
    "drives of OpenSfM": (lambda folder: drives(folder, "opensfm"), ["dataset.poses=opensfm dataset.plane=xz"]),
    "drives of nerfstudio": (lambda folder: drives(folder, "nerfstudio"), ["poses=nerfstudio dataset.plane=xz"]),
    "drives by GPS": (
        lambda folder: drives(folder, "gps"),
        ["map (gps): 8 poses, of 8 of 8 images", "dataset.poses=gps", "the camera is assumed to point along the path"],
    ),
    "GPS of two towns": (_apart, ["map (gps): 8 poses", "over 5,000 x 0 m"]),
    "rides by GPS": (_placed_rides, ["places=gps", "dataset.poses=gps", "GPS: 16 images over 140 x 0 m, 16 with a d"]),
    "smaller copies": (_copies, ["dataset.map=map/images", "{evening_run_images: \"evening run/images\"}"]),
    "a name for a shell": (lambda folder: _classes(folder / "it's (2) [b], c=d $x"), ["dataset=image_folder"]),
}  # fmt: skip
