"""A small dataset that can be rendered, and what its tests run in processes of their own."""

import os
import time
from functools import cached_property
from pathlib import Path

import numpy as np

from sextant.data.rendered import ArraySpec, RenderPlan, load_store, open_store


class ToyPlan(RenderPlan):
    """Images that hold their index, in chunks of 4; notes every chunk that it renders in the file ``log``."""

    name = "toy"
    source_sha256 = "0" * 64
    chunk = 4

    def __init__(self, count=22, *, shape=(6, 5, 3), salt=0, pause_s=0.0, log=None):
        self.config = {"count": count, "shape": list(shape), "salt": salt}
        self.pause_s, self.log = pause_s, log
        self.world_built = False

    @property
    def count(self):
        return self.config["count"]

    @cached_property
    def arrays(self):
        return {"image": ArraySpec(tuple(self.config["shape"]), np.uint8), "depth": ArraySpec((), "f4")}

    @cached_property
    def facts(self):
        self.world_built = True
        return {"street_km": 1.25, "splits": {"train": self.count - 2, "test": 2}, "conditions": ["sun", "rain"]}

    @cached_property
    def columns(self):
        self.world_built = True
        return {"pose": np.arange(3.0 * self.count).reshape(self.count, 3)}

    def render(self, start, stop):
        self.world_built = True
        if self.log is not None:
            with Path(self.log).open("a") as file:
                file.write(f"{start} {os.getpid()}\n")
        time.sleep(self.pause_s)
        indices = np.arange(start, stop)
        rows = [np.random.default_rng((self.config["salt"], i)).integers(0, 256, self.config["shape"]) for i in indices]
        return {"image": np.array(rows, dtype=np.uint8), "depth": indices.astype("f4")}


class ToyWorld:
    """The dataset of a config."""

    name = "toy"

    def __init__(self, roots, size=22, pause_s=0.0):
        self._plan = ToyPlan(size, pause_s=pause_s)

    def plan(self):
        return self._plan


def fill(cache, options, threads=1, waits=None):
    """In a process of its own: fill the store; ``waits`` is a file for what it says while it waits."""
    told = {} if waits is None else {"notify": Path(waits).write_text}
    open_store(ToyPlan(**options), cache, **told).fill(threads=threads)


def read_item(cache, options, index, queue):
    """In a process of its own: read one item."""
    queue.put(open_store(ToyPlan(**options), cache).read("image", index))


def chunks_rendered(log):
    """First items of the chunks that were rendered, in order."""
    return [int(line.split()[0]) for line in Path(log).read_text().splitlines()] if Path(log).exists() else []


def contents(cache):
    """The bytes of a store's arrays, by file name."""
    (directory,) = [path for path in Path(cache).iterdir() if path.name.startswith("toy-")]
    assert load_store(directory).complete
    return {path.name: path.read_bytes() for path in directory.glob("*.npy")}
