"""The ROS 1 node on a drive that is played to it: a master, the player, the node and a listener, all on this machine.

``python -m benchmarks.robot_bag output=<folder> [images=600] [initial=true]``

A robot drives through the office of ``zoo:office`` by night, its camera off the middle and turned. A bag has its images
at 5 Hz and odometry at 25 Hz with the errors of COLD's wheels, in a frame that begins elsewhere. ``initial=true`` gives
a pose one metre ahead of the true one on ``/initialpose`` after six seconds. The transform that is heard is compared
with the truth.

ROS 1 from Debian 12: ``apt install --no-install-recommends rosout python3-rosmaster python3-rospy python3-rosbag
python3-nav-msgs python3-sensor-msgs python3-diagnostic-msgs python3-tf2-msgs``.
"""

import json
import os
import socket
import subprocess
import sys
import time
import xmlrpc.client
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy import ndarray

from sextant.chapters.localization.data.drive import between, compose
from sextant.chapters.localization.data.simulated import simulated_motion
from sextant.config import validate
from sextant.console.arguments import parse_arguments
from sextant.kit.assemble import build_dataset
from sextant.worlds.odometry import COLD_WHEELS
from sextant.zoo import model_file, read_card

USAGE = "python -m benchmarks.robot_bag output=<folder> [images=600] [initial=true]"
KEYS = {
    "output": "folder for the bag, what was heard, and the figure",
    "images": "length of the drive",
    "initial": "true: publish a pose that is off by a metre on /initialpose after 30 images",
}
#: of the drives of zoo:office: the second by night
DRIVE = 5
IMAGE_S, ODOMETRY_S, BEGIN_S = 0.2, 0.04, 1_000.0
#: the camera on the base: metres ahead, metres to the left, degrees to the left; and where the odometry frame begins
MOUNTING, ORIGIN = (0.2, -0.1, 15.0), np.array([3.0, -2.0, 0.7])
#: metres that the initial pose is ahead of the true one, and the images before it
WRONG_M, WRONG_AFTER = 1.0, 30
#: where Debian has the packages of ROS, which come after those of this Python
PACKAGES = "/usr/lib/python3/dist-packages"
NODE = Path(__file__).parents[1] / "examples" / "ros1_localizer.py"


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    folder = Path(given.get("output", "robot_bag"))
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / f"drive_{int(given.get('images', '600'))}.npz"
    drive = made_drive(kept, int(given.get("images", "600")))
    initial = given.get("initial") == "true"
    heard = played(folder, kept if initial else None)
    report(folder, drive, heard, "with" if initial else "without")


def made_drive(kept: Path, images: int) -> dict[str, ndarray]:
    """Times, poses of the base and odometry of the drive, which is rendered once, and its bag."""
    folder = kept.parent
    if not kept.is_file():
        card = read_card(model_file("zoo:office"))["model"]["config"]
        paths = {**card["paths"], "cache": str(folder / "cache")}
        plan = build_dataset(validate({**card, "paths": paths})).plan()
        start = int((plan.columns["run"] == DRIVE).argmax())
        pictures = plan.render(start, start + images)["images"]
        cameras = plan.shots.pose[start : start + images][:, [0, 1, 3]].astype(np.float64)
        mounted = np.array([[MOUNTING[0], MOUNTING[1], np.radians(MOUNTING[2])]])
        bases = compose(cameras, np.repeat(between(mounted, np.zeros((1, 3))), images, axis=0))
        seen_s = BEGIN_S + IMAGE_S * np.arange(images)
        times = np.arange(BEGIN_S, seen_s[-1] + 1e-9, ODOMETRY_S)
        unwrapped = np.column_stack([bases[:, :2], np.unwrap(bases[:, 2])])
        base = np.column_stack([np.interp(times, seen_s, column) for column in unwrapped.T])
        odometry = [ORIGIN]
        for motion in simulated_motion(base, COLD_WHEELS, 1.0, 0, "drive")[1:]:
            odometry.append(compose(odometry[-1][None], motion[None])[0])
        np.savez(kept, images=pictures, seen_s=seen_s, times_s=times, base=base, odometry=np.array(odometry))
    with np.load(kept) as file:
        drive = dict(file)
    (folder / "drive.bag").unlink(missing_ok=True)
    write_bag(folder / "drive.bag", drive)
    return drive


def write_bag(path: Path, drive: dict[str, ndarray]) -> None:
    """Images, CameraInfo and odometry as a ROS 1 bag."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    new = lambda name, *values: store.types[name](*values)  # noqa: E731

    def header(second: float, frame: str) -> object:
        stamp = new("builtin_interfaces/msg/Time", int(second), round(second % 1 * 1e9))
        return new("std_msgs/msg/Header", 0, stamp, frame)

    height, width = drive["images"].shape[1:3]
    focal = height / 2 / np.tan(np.radians(30.0))  # 60 degrees high
    matrix = np.array([focal, 0, (width - 1) / 2, 0, focal, (height - 1) / 2, 0, 0, 1.0])
    messages = []
    for second, pixels in zip(drive["seen_s"].tolist(), drive["images"], strict=True):
        at = header(second, "camera")
        image = new("sensor_msgs/msg/Image", at, height, width, "rgb8", 0, 3 * width, pixels.reshape(-1))
        region = new("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        projection = np.insert(matrix, [3, 6, 9], 0.0)
        camera = new("sensor_msgs/msg/CameraInfo", at, height, width, "plumb_bob", np.zeros(5), matrix,
                     np.eye(3).reshape(-1), projection, 0, 0, region)  # fmt: skip
        messages += [(second, "/camera/image_raw", image), (second, "/camera/camera_info", camera)]
    for second, (x, y, heading) in zip(drive["times_s"].tolist(), drive["odometry"].tolist(), strict=True):
        pose = new("geometry_msgs/msg/Pose", new("geometry_msgs/msg/Point", x, y, 0.0),
                   new("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)))  # fmt: skip
        zero = new("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        moved = new("geometry_msgs/msg/TwistWithCovariance", new("geometry_msgs/msg/Twist", zero, zero), np.zeros(36))
        placed = new("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36))
        messages.append((second, "/odom", new("nav_msgs/msg/Odometry", header(second, "odom"), "base", placed, moved)))
    with Writer(path) as writer:
        links: dict[str, object] = {}
        for second, topic, message in sorted(messages, key=lambda each: each[0]):
            kind = message.__msgtype__
            links.setdefault(topic, writer.add_connection(topic, kind, typestore=store) if topic not in links else None)
            writer.write(links[topic], round(second * 1e9), store.serialize_ros1(message, kind))


def played(folder: Path, initial: Path | None) -> list[dict[str, object]]:
    """Start the master, the node, a listener and the player; what was heard."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    master = f"http://127.0.0.1:{port}"
    log = (folder / "log").absolute()
    ros = {"ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1", "ROS_LOG_DIR": str(log)}
    mine = {**os.environ, **ros}
    debian = {key: value for key, value in mine.items() if key != "PYTHONPATH"}
    heard = folder / "heard.jsonl"
    heard.unlink(missing_ok=True)
    here = "import runpy, sys; sys.path.append(sys.argv.pop(1)); "
    script = [sys.executable, "-c", f"{here}runpy.run_path(sys.argv[1], run_name='__main__')", PACKAGES, str(NODE)]
    ear = [sys.executable, "-c", f"{here}from benchmarks.robot_bag import listen; listen(sys.argv[1:])", PACKAGES]
    pose = [] if initial is None else [str(initial)]
    with ExitStack() as running:

        def start(words: list[str], environment: dict[str, str]) -> "subprocess.Popen[bytes]":
            process = subprocess.Popen(words, env=environment)
            running.callback(process.wait)
            running.callback(process.terminate)
            return process

        start(["/usr/bin/rosmaster", "--core", "-p", str(port)], debian)
        api = xmlrpc.client.ServerProxy(master)
        wait_for(lambda: api.getPid("/benchmark")[0] == 1, "the master")
        api.setParam("/benchmark", "/use_sim_time", True)
        topics = ["image:=/camera/image_raw", "camera_info:=/camera/camera_info", "odom:=/odom"]
        start([*script, "_map:=zoo:office", f"_mounting:={json.dumps(MOUNTING)}", *topics], mine)
        start([*ear, str(heard), *pose], mine)

        def listening(topic: str, name: str) -> bool:
            return any(each == topic and name in nodes for each, nodes in api.getSystemState("/benchmark")[2][1])

        wait_for(lambda: listening("/odom", "/sextant_localizer") and listening("/tf", "/listener"), "the nodes")
        time.sleep(2.0)  # connections between subscribers and publishers
        subprocess.run(["/usr/bin/rosbag", "play", "--clock", "-q", "-d", "5", str(folder / "drive.bag")],
                       env=debian, check=True)  # fmt: skip
        time.sleep(2.0)
    return [json.loads(line) for line in heard.read_text().splitlines()]


def wait_for(ready: object, what: str, seconds: float = 120.0) -> None:
    """Wait until a function returns true."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            if ready():  # type: ignore[operator]
                return
        except OSError:
            pass
        time.sleep(0.2)
    raise SystemExit(f"{what} did not start in {seconds:g} s")


def listen(arguments: list[str]) -> None:
    """Write each message of the node to a file; after 30 states, give an initial pose."""
    import rospy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from tf2_msgs.msg import TFMessage

    from sextant.chapters.localization.data.ros_messages import planar_pose, set_planar

    rospy.init_node("listener")
    first = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1, latch=True)
    begin = [dict(np.load(arguments[1]))] if len(arguments) > 1 else []
    newest, states = [rospy.Time()], []

    with open(arguments[0], "a", buffering=1) as file:

        def write(kind: str, stamp: object, **values: object) -> None:
            now = rospy.get_time()
            file.write(json.dumps({"kind": kind, "stamp_s": stamp.to_sec(), "heard_s": now, **values}) + "\n")  # type: ignore[attr-defined]

        def on_transform(message: object) -> None:
            for each in message.transforms:  # type: ignore[attr-defined]
                at, turned = each.transform.translation, each.transform.rotation
                pose = type("Pose", (), {"position": at, "orientation": turned})
                frames = [each.header.frame_id, each.child_frame_id]
                write("transform", each.header.stamp, frames=frames, pose=planar_pose(pose).tolist())

        def on_pose(message: object) -> None:
            found = message.pose  # type: ignore[attr-defined]
            covariance = list(found.covariance)
            write("pose", message.header.stamp, pose=planar_pose(found.pose).tolist(), covariance=covariance)  # type: ignore[attr-defined]

        def on_cloud(message: object) -> None:
            write("cloud", message.header.stamp, poses=[planar_pose(each).tolist() for each in message.poses])  # type: ignore[attr-defined]

        def on_state(message: object) -> None:
            (state,) = message.status  # type: ignore[attr-defined]
            states.append(state)
            if begin and len(states) == WRONG_AFTER:
                drive, given = begin.pop(), PoseWithCovarianceStamped()
                (pose,) = at_times(drive["times_s"], drive["base"], np.array([newest[0].to_sec()]))
                pose = compose(pose[None], np.array([[WRONG_M, 0.0, 0.0]]))[0]
                given.header.stamp, given.header.frame_id = newest[0], "map"
                set_planar(given.pose.pose, pose)
                given.pose.covariance = np.diag([0.25, 0.25, 0, 0, 0, 0.07]).ravel().tolist()
                first.publish(given)
                write("initial", newest[0], pose=pose.tolist())
            values = {each.key: each.value for each in state.values}
            write("state", message.header.stamp, level=state.level, message=state.message, values=values)  # type: ignore[attr-defined]

        def on_odometry(message: object) -> None:
            newest[0] = message.header.stamp  # type: ignore[attr-defined]

        rospy.Subscriber("/tf", TFMessage, on_transform)
        rospy.Subscriber("/pose", PoseWithCovarianceStamped, on_pose)
        rospy.Subscriber("/particlecloud", PoseArray, on_cloud)
        rospy.Subscriber("/diagnostics", DiagnosticArray, on_state)
        rospy.Subscriber("/odom", Odometry, on_odometry)
        rospy.spin()


def at_times(times_s: ndarray, poses: ndarray, wanted_s: ndarray) -> ndarray:
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    return np.column_stack([np.interp(wanted_s, times_s, column) for column in unwrapped.T])


def odometry_alone(drive: dict[str, ndarray]) -> ndarray:
    """Poses of the base in the map by its true start and odometry."""
    start = compose(drive["base"][:1], between(drive["odometry"][:1], np.zeros((1, 3))))
    return compose(np.repeat(start, len(drive["odometry"]), axis=0), drive["odometry"])


def report(folder: Path, drive: dict[str, ndarray], heard: list[dict[str, object]], initial: str) -> None:
    """Print how far the robot is from where the transform and its odometry put it, and draw both."""
    kinds = {kind: [each for each in heard if each["kind"] == kind] for kind in ("transform", "pose", "cloud", "state")}
    print(f"{initial} /initialpose: " + ", ".join(f"{len(rows):,} {kind}s" for kind, rows in kinds.items()))
    frames = {" from ".join(each["frames"]) for each in kinds["transform"]}
    print(f"images: {len(drive['images']):,}; transforms: {', '.join(frames)}")
    stamps = np.array([each["stamp_s"] for each in kinds["transform"]]) - 0.1  # dated ahead by transform_tolerance
    told = np.array([each["pose"] for each in kinds["transform"]])
    odometry, base = (at_times(drive["times_s"], drive[key], stamps) for key in ("odometry", "base"))
    found = compose(told, odometry)
    metres = np.hypot(*(found - base)[:, :2].T)
    degrees = np.abs(np.degrees(np.angle(np.exp(1j * (found - base)[:, 2]))))
    right = (metres <= 0.5) & (degrees <= 10)
    print(f"first transform at {stamps[0] - BEGIN_S:.1f} s; within 0.5 m and 10 degrees: {right.mean():.1%}")
    for name, values in (("m", metres), ("degrees", degrees)):
        print(f"error of the base in {name}: median {np.median(values):.3f}, 95 % {np.quantile(values, 0.95):.3f}, "
              f"max {values.max():.3f}")  # fmt: skip
    drifted = np.hypot(*(odometry_alone(drive) - drive["base"])[:, :2].T)
    print(f"odometry alone, from the true start: up to {drifted.max():.2f} m off")
    late = np.array([each["heard_s"] - each["stamp_s"] for each in kinds["state"]])
    steps = np.array([float(each["values"]["step_ms"]) for each in kinds["state"]])
    levels = [each["message"] for each in kinds["state"] if each["level"]]
    print(f"step: median {np.median(steps):.0f} ms, 95 % {np.quantile(steps, 0.95):.0f} ms")
    waited = 1000 * np.quantile(late, (0.5, 0.95))
    print(f"from image to diagnostics: median {waited[0]:.0f} ms, 95 % {waited[1]:.0f} ms")
    print(f"states other than OK: {len(levels)} {sorted(set(levels))[:4]}")
    inside = []
    for each in kinds["pose"]:
        (truth,) = at_times(drive["times_s"], drive["base"], np.array([each["stamp_s"]]))
        off = np.array(each["pose"]) - truth
        off[2] = np.angle(np.exp(1j * off[2]))
        covariance = np.reshape(each["covariance"], (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
        inside.append(off @ np.linalg.solve(covariance, off) <= 7.815)  # 95 % of chi-square with 3 degrees
    for each in (row for row in heard if row["kind"] == "initial"):
        begun = each["stamp_s"]
        around = (stamps >= begun) & (stamps < begun + 0.4)
        off = metres[around & (np.abs(metres - WRONG_M) < 0.05)]
        back = stamps[(stamps > begun + 0.4) & (metres < 0.5)][0] - begun
        print(f"initial pose {WRONG_M:g} m off at {begun - BEGIN_S:.1f} s: {len(off)} transforms by it, the first "
              f"{off[0]:.3f} m off; within 0.5 m again after {back:.1f} s")  # fmt: skip
    print(f"true poses within the 95 % regions of the covariance: {np.mean(inside):.1%} of {len(inside):,}")
    draw(folder / f"transform_{initial}_initialpose.png", drive, kinds, found, base, stamps, metres)


def draw(path: Path, drive: dict[str, ndarray], kinds: dict[str, list], found: ndarray, base: ndarray, stamps: ndarray,
         metres: ndarray) -> None:  # fmt: skip
    """The robot over the map, where the transform puts it, and the error over time."""
    import matplotlib.pyplot as plt

    from sextant import Localizer

    mapped = Localizer.load("zoo:office").model.map.poses.numpy()
    figure, (plan, error) = plt.subplots(2, 1, figsize=(9, 6.6), height_ratios=(2.2, 1), layout="constrained")
    plan.plot(*mapped[:, :2].T, ".", color="0.8", ms=2, label="map images")
    alone = odometry_alone(drive)
    plan.plot(*alone[:, :2].T, ":", color="C1", label="odometry alone")
    plan.plot(*drive["base"][:, :2].T, color="k", lw=3, alpha=0.35, label="true base")
    plan.plot(*found[:, :2].T, color="C0", lw=1, label="map → odom heard, with odometry")
    cloud = np.array(kinds["cloud"][-1]["poses"])
    plan.quiver(*cloud[:, :2].T, np.cos(cloud[:, 2]), np.sin(cloud[:, 2]), color="C3", scale=40, width=0.002,
                label="last particlecloud")  # fmt: skip
    plan.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    plan.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, fontsize=7, frameon=False)
    error.semilogy(stamps - BEGIN_S, metres, ".", ms=2)
    error.set(xlabel="time (s)", ylabel="error (m)")
    figure.savefig(path, dpi=110)
    print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
