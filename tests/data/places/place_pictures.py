"""Folders of small pictures to place."""

import numpy as np
from PIL import Image

from sextant.chapters.places.data import ImageRows, PlaceImages


def picture(number, height=16, width=24):
    """Noise that differs for every number."""
    return np.random.default_rng(number).integers(0, 256, (height, width, 3), np.uint8)


def write_pictures(folder, names, first=0):
    """A file of noise for each name."""
    for k, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(picture(first + k)).save(path)
    return folder


def aligned_places(frames=20, traverses=2, **columns):
    """Images in memory whose pixels tell traverse and frame; no positions."""
    traverse, frame = (grid.ravel() for grid in np.mgrid[:traverses, :frames])
    images = np.broadcast_to((traverse * 100 + frame)[:, None, None, None], (len(frame), 4, 6, 3)).astype(np.uint8)
    names = tuple(f"{t}/{f}" for t, f in zip(traverse, frame, strict=True))
    conditions = tuple(f"season{t}" for t in range(traverses))
    return PlaceImages(ImageRows(images), traverse, conditions, frame, names, **columns)
