"""Files of reconstructions, written from poses by the formats' descriptions."""

import json
import struct

import numpy as np
from scipy.spatial.transform import Rotation


def some_poses(count, seed=0):
    """``world_from_camera`` of cameras that look anywhere."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=seed).as_matrix()
    poses[:, :3, 3] = np.random.default_rng(seed).normal(scale=5, size=(count, 3))
    return poses


def _quaternions(poses):
    """(w, x, y, z, translation) of ``camera_from_world``."""
    inverse = np.linalg.inv(poses)
    turned = Rotation.from_matrix(inverse[:, :3, :3]).as_quat()
    return np.column_stack([turned[:, 3], turned[:, :3], inverse[:, :3, 3]])


def colmap_text(path, names, poses):
    lines = ["# Image list with two lines of data per image:"]
    for number, (name, row) in enumerate(zip(names, _quaternions(poses), strict=True), start=1):
        lines += [f"{number} {' '.join(map(repr, row.tolist()))} 1 {name}", "1.5 2.5 -1" if number % 2 else ""]
    path.write_text("\n".join(lines) + "\n")
    path.with_name("cameras.txt").write_text("1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n")
    return path


def colmap_binary(path, names, poses):
    content = struct.pack("<Q", len(names))
    for number, (name, row) in enumerate(zip(names, _quaternions(poses), strict=True), start=1):
        content += struct.pack("<I7dI", number, *row, 1) + name.encode() + b"\0"
        content += struct.pack("<QddQ", 1, 1.5, 2.5, 2**64 - 1)
    path.write_bytes(content)
    return path


def opensfm(path, names, poses):
    inverse = np.linalg.inv(poses)
    turns = Rotation.from_matrix(inverse[:, :3, :3]).as_rotvec()
    shots = {
        name: {"rotation": turn.tolist(), "translation": pose[:3, 3].tolist(), "camera": "phone"}
        for name, turn, pose in zip(names, turns, inverse, strict=True)
    }
    lens = {"projection_type": "perspective", "width": 640, "height": 480, "focal": 0.8, "k1": 0.0, "k2": 0.0}
    path.write_text(json.dumps([{"cameras": {"phone": lens}, "shots": shots, "points": {}}]))
    return path


def nerfstudio(path, names, poses):
    matrices = poses @ np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [
        {"file_path": f"./{name}", "transform_matrix": matrix.tolist()}
        for name, matrix in zip(names, matrices, strict=True)
    ]
    path.write_text(json.dumps({"w": 640, "h": 480, "fl_x": 512.0, "fl_y": 512.0, "frames": frames}))
    return path


#: name of the file and what writes it, by a name of the kind
WRITERS = {
    "colmap": ("images.bin", colmap_binary),
    "colmap text": ("images.txt", colmap_text),
    "opensfm": ("reconstruction.json", opensfm),
    "nerfstudio": ("transforms.json", nerfstudio),
}
