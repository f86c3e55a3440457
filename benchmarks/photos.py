"""The cost of calibrating a photo: straightening 12 megapixels against OpenCV, and the network on one image."""

import cv2
import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from sextant.data.photos import undistort_photo
from sextant.models import CalibrationNet, OrientedCNN

WIDTH, HEIGHT = 4000, 3000
FOCAL, K1, K2 = 2600.0, -0.2, 0.0284


def run() -> list[tuple[str, str, str, str, str]]:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    image = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    matrix = np.array([[FOCAL, 0, WIDTH / 2 - 0.5], [0, FOCAL, HEIGHT / 2 - 0.5], [0, 0, 1]])
    lens = np.array([K1, K2, 0, 0, 0])

    def opencv() -> None:
        maps = cv2.initUndistortRectifyMap(matrix, lens, None, matrix, (WIDTH, HEIGHT), cv2.CV_32FC1)
        cv2.remap(image, *maps, cv2.INTER_LINEAR)

    straightened = medians({"ours": lambda: undistort_photo(image, FOCAL, K1, K2, "all"), "OpenCV": opencv}, 5)
    network = CalibrationNet(OrientedCNN(6, (72, 96), 256), 256).eval()
    one, aspect = torch.rand(1, 3, 72, 96), torch.tensor([4 / 3])
    with torch.inference_mode():
        latency = medians({"one": lambda: network(one, aspect)}, 50)["one"]
    ours, theirs = straightened["ours"], straightened["OpenCV"]
    return [
        (
            "straighten 12 megapixels",
            f"{ours:.2f} s",
            f"OpenCV, maps and remap, {theirs:.2f} s",
            f"{ours / theirs:.2f}",
            "",
        ),
        ("calibration_tiny, one image of 96x72", f"{1e3 * latency:.1f} ms", "", "", ""),
    ]
