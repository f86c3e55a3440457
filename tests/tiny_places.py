"""Places to be recognised: pictures by day and by night, a descriptor that is pixels, a network at its start."""

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter

from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.registry import chapter_of
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION


def scene(number, night=False):
    """A smooth picture of one place; at night darker, with noise of its own."""
    rng = np.random.default_rng(number)
    picture = gaussian_filter(rng.normal(size=(32, 48, 3)), (3, 3, 0))
    picture = 128 + 90 * picture / np.abs(picture).max()
    if night:
        picture = 0.6 * picture + np.random.default_rng(number + 10_000).normal(scale=8, size=picture.shape)
    return Image.fromarray(picture.clip(0, 255).astype(np.uint8))


def ride(folder, numbers, night=False, name="{k:03d}.png"):
    """A folder of pictures of these places."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, number in enumerate(numbers):
        scene(number, night).save(folder / name.format(k=k, number=number))
    return folder


def place_words(folder, outputs, *overrides, conditions=("day", "night")):
    """What is typed for a run on folders <split>/<condition> of pictures of the same places in the same order."""
    shown = {split: ", ".join(f"{c}: {split}/{c}" for c in conditions) for split in ("train", "val", "test")}
    ends = ("positive=0", "negative=1")
    return [
        "task=place_recognition", "dataset=place_folders", f"dataset.folder={folder}", "dataset.places=order",
        *(f"dataset.{split}={{{folders}}}" for split, folders in shown.items()), "dataset.height=16",
        "dataset.width=24", *(f"task.{kind}.frames.{end}" for kind in ("tolerance", "test_tolerance") for end in ends),
        "trainer.progress=false", "tracking=none", f"paths.outputs={outputs}", *overrides,
    ]  # fmt: skip


class Pixels:
    """Describes photos by their pixels, so that what is right is known."""

    size = ImageSize(16, 24)
    model = "pixels"

    def describe(self, images):
        flat = images.reshape(len(images), -1).astype(np.float32)
        return flat - flat.mean(axis=1, keepdims=True)


def tiny_checkpoint(path):
    """The checkpoint of a run of place recognition whose weights are as they began."""
    raw = to_plain(
        compose(
            ["task=place_recognition", "dataset=place_folders", "dataset.folder=x", "dataset.height=32",
             "dataset.width=48", "pooling.grid=null", "task.dimension=32", "task.baselines=false"]
        )
    )  # fmt: skip
    assert validate(raw)
    spec = {"height": 32, "width": 48, "channels": 3}
    torch.manual_seed(0)
    module = chapter_of("place_recognition").module(validate(raw), spec, training=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    label = {"schema_version": SCHEMA_VERSION, "config": raw, "spec": spec, "task": "place_recognition"}
    torch.save({KEY: label, "state_dict": module.state_dict()}, path)
    return path
