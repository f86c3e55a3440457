"""ROS bags made up for tests, of both versions."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

IMAGE, COMPRESSED, ODOMETRY = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "nav_msgs/msg/Odometry"
CAMERA = "sensor_msgs/msg/CameraInfo"


class Bags:
    """Writes a bag of a version: messages of topics at seconds."""

    def __init__(self, version):
        self.version = version
        self.types = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.LATEST)

    def new(self, name, **fields):
        return self.types.types[name](**fields)

    def header(self, seconds):
        stamp = self.new("builtin_interfaces/msg/Time", sec=int(seconds), nanosec=round(seconds % 1 * 1e9))
        more = {"seq": 0} if self.version == 1 else {}
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id="camera", **more)

    def image(self, seconds, pixels, encoding="rgb8", padding=0):
        height, width = pixels.shape[:2]
        rows = np.pad(pixels.reshape(height, -1), [(0, 0), (0, padding)])
        return self.new(
            IMAGE,
            header=self.header(seconds),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.reshape(-1),
        )

    def raw_image(self, seconds, data, height, width, encoding, step, is_bigendian=0):
        """An image of given bytes."""
        fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": is_bigendian, "step": step}
        return self.new(IMAGE, header=self.header(seconds), data=np.frombuffer(data, np.uint8), **fields)

    def camera(self, seconds, width, height, matrix, distortion=(), model="plumb_bob", projection=None, binning=0):
        region = self.new(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        given = {
            "k": np.array(matrix, float).reshape(-1),
            "d": np.array(distortion, float),
            "r": np.eye(3).reshape(-1),
            "p": np.zeros(12) if projection is None else np.array(projection, float).reshape(-1),
        }
        given = {(name.upper() if self.version == 1 else name): value for name, value in given.items()}
        size = {"width": width, "height": height, "binning_x": binning, "binning_y": binning, "roi": region}
        return self.new(CAMERA, header=self.header(seconds), distortion_model=model, **size, **given)

    def compressed(self, seconds, data):
        return self.new(COMPRESSED, header=self.header(seconds), format="png", data=np.frombuffer(data, np.uint8))

    def odometry(self, seconds, x, heading, y=0.0):
        point = self.new("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        turned = {"x": 0.0, "y": 0.0, "z": np.sin(heading / 2), "w": np.cos(heading / 2)}
        pose = self.new(
            "geometry_msgs/msg/Pose", position=point, orientation=self.new("geometry_msgs/msg/Quaternion", **turned)
        )
        zero = self.new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        return self.new(
            ODOMETRY,
            header=self.header(seconds),
            child_frame_id="base",
            pose=self.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.new(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.new("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=np.zeros(36),
            ),
        )

    def write(self, path, messages, storage=StoragePlugin.SQLITE3):
        """``messages``: topic, seconds of the recording, message."""
        path = path / ("drive.bag" if self.version == 1 else "drive")
        writer = Writer1(path) if self.version == 1 else Writer2(path, version=9, storage_plugin=storage)
        serialize = self.types.serialize_ros1 if self.version == 1 else self.types.serialize_cdr
        with writer:
            links = {}
            for topic, seconds, message in messages:
                kind = message.__msgtype__
                if topic not in links:
                    links[topic] = writer.add_connection(topic, kind, typestore=self.types)
                writer.write(links[topic], int(seconds * 1e9), serialize(message, kind))
        return path
