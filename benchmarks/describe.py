"""Describing an image for place recognition: our default network against common alternatives.

One thread, float32, inference mode. The peers' descriptors use a ResNet-18 (G. Berton et al., "Deep visual
geo-localization benchmark", CVPR 2022, among others), whose layers alone are timed, on the same image and on one of
480x640, their usual size. Tasks alternate, so that all run under the same load; ratios are of medians of one run.
"""

import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from sextant.baselines import Hog
from sextant.models import FeatureMap, OrientedCNN, PlaceNet
from sextant.models.pooling import Flatten
from sextant.models.torchvision_backbone import torchvision_backbone

HEIGHT, WIDTH, LARGE, BATCH, REPEATS = 64, 96, (480, 640), 64, 31

Row = tuple[str, str, str, str, str]


def run(repeats: int = REPEATS) -> list[Row]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _rows(repeats)
    finally:
        torch.set_num_threads(threads)


@torch.inference_mode()
def _rows(repeats: int) -> list[Row]:
    network = _ours().eval()
    peer = torch.nn.Sequential(*list(torchvision_backbone("resnet18", 3, LARGE, 128).children())[:-2]).eval()
    images = torch.rand(BATCH, 3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0))
    large = torch.rand(1, 3, *LARGE, generator=torch.Generator().manual_seed(1))
    grey, hog = (images.permute(0, 2, 3, 1).numpy() * 255).astype(np.uint8), Hog(HEIGHT, WIDTH)
    single = medians(
        {
            "ours": lambda: network(images[:1]),
            "ResNet-18": lambda: peer(images[:1]),
            f"ResNet-18 at {LARGE[0]}x{LARGE[1]}": lambda: peer(large),
            "HOG (scikit-image)": lambda: hog.describe(grey[:1]),
        },
        repeats,
        warm=2,
    )
    both = {"ours": lambda: network(images), "ResNet-18": lambda: peer(images)}
    many = medians(both, max(3, repeats // 4), warm=2)
    what = f"one image of {HEIGHT}x{WIDTH}"
    rows = [_row(what, single, other) for other in single if other != "ours"]
    return [*rows, _row(f"each of {BATCH}", {name: seconds / BATCH for name, seconds in many.items()}, "ResNet-18")]


def _ours() -> PlaceNet:
    """The network of ``task=place_recognition``, untrained."""
    size = (HEIGHT, WIDTH)
    backbone = OrientedCNN(3, size, 128, widths=(96, 128), strides=(1, 2), grid=(1, 1))
    features = FeatureMap(backbone, 3, size, layer=None)
    return PlaceNet(features, Flatten(channels=features.channels, size=features.size), 128)


def _row(what: str, seconds: dict[str, float], other: str) -> Row:
    ours, theirs = seconds["ours"], seconds[other]
    return what, f"{1e3 * ours:.2f} ms", f"{other} {1e3 * theirs:.2f} ms", f"{ours / theirs:.2f}", ""
