"""Pictures taken of worlds: which scene, from where, under which condition - and the plan that renders them."""

import threading
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray

from sextant.data.rendered import ArraySpec, RenderPlan, modules_sha256
from sextant.errors import ArgumentError
from sextant.geometry import Camera, level_camera_pose
from sextant.worlds.appearance import Appearance, condition, with_factors
from sextant.worlds.renderer import Rays, Renderer

SPLITS = ("train", "val", "test")
#: scenes held at once: one in use and the next
HELD_SCENES = 2

#: the part of ``sextant.geometry`` that pictures depend on
OPTICS = tuple(
    f"sextant.geometry.{name}"
    for name in ("_series", "camera", "distortion", "equirectangular", "perspective", "poses", "rotations")
)


@dataclass(frozen=True)
class Shots:
    """One row a picture, in the order they are stored.

    Attributes:
        scene: number of the world the picture is taken in.
        condition: number of the appearance.
        split: index into the plan's splits.
        place: number of the place; equal numbers of one split are the same place under another condition.
        pose: x, y, z in metres, heading counter-clockwise from x, tilt (up) and roll in radians.
        velocity: metres a second along x, y, z and radians a second about z, for motion blur.
        sun_turn_deg, exposure_ev: added to the appearance, so that no two panoramas have the same light.
    """

    scene: Int64[ndarray, "n"]
    condition: Int64[ndarray, "n"]
    split: Int64[ndarray, "n"]
    place: Int64[ndarray, "n"]
    pose: Float64[ndarray, "n 6"]
    velocity: Float64[ndarray, "n 4"]
    sun_turn_deg: Float64[ndarray, "n"]
    exposure_ev: Float64[ndarray, "n"]

    @classmethod
    def of(
        cls,
        scene: object,
        condition: object,
        split: object,
        place: object,
        pose: Float64[ndarray, "n 6"],
        **more: object,
    ) -> "Shots":
        """Shots with scalars spread over all rows; what is not given is zero."""
        n = len(pose)

        def row(value: object, kind: type = np.int64) -> ndarray:
            return np.broadcast_to(np.asarray(value, kind), n).copy()

        velocity = np.broadcast_to(np.asarray(more.get("velocity", 0.0), float), (n, 4)).copy()
        sun, exposure = (row(more.get(key, 0.0), np.float64) for key in ("sun_turn_deg", "exposure_ev"))
        return cls(row(scene), row(condition), row(split), row(place), np.asarray(pose, float), velocity, sun, exposure)

    @classmethod
    def join(cls, parts: list["Shots"]) -> "Shots":
        """All shots, one part after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def __len__(self) -> int:
        return len(self.pose)


class WorldPlan(RenderPlan):
    """A rendered dataset of pictures of procedural worlds.

    Args:
        name: of the dataset.
        config: all that decides what is rendered.
        conditions: names of the appearances, or mappings with a ``name``, a ``condition`` and single factors.
        samples: rays a pixel, a square number.
    """

    def __init__(self, name: str, config: Mapping[str, Any], conditions: list[Any], samples: int):
        self.name = name
        self.config = dict(config)
        self.source_sha256 = modules_sha256("sextant.worlds", "sextant.data.worlds", *OPTICS)
        self.samples = samples
        self.condition_names, self.appearances = read_conditions(conditions)
        self._scenes = _Held(HELD_SCENES)

    def __getstate__(self) -> dict[str, Any]:
        return {
            key: value
            for key, value in self.__dict__.items()
            if not isinstance(getattr(type(self), key, None), cached_property) and key != "_scenes"
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._scenes = _Held(HELD_SCENES)

    # -- what a dataset says -------------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def camera(self) -> Camera:
        """The camera of every picture."""

    @abstractmethod
    def lay_out(self) -> Shots:
        """All pictures: quick, without building a mesh."""

    @abstractmethod
    def build(self, scene: int, appearance: Appearance) -> Renderer:
        """A renderer of one world under an appearance."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Facts of the manifest besides those of every dataset of images."""

    # -- what the store asks -------------------------------------------------------------------------------------------

    @cached_property
    def shots(self) -> Shots:
        """All pictures."""
        return self.lay_out()

    @cached_property
    def rays(self) -> Rays:
        """The rays of the camera."""
        return Rays.of_camera(self.camera, self.samples)

    @property
    def count(self) -> int:
        """Number of pictures."""
        return len(self.shots)

    @property
    def arrays(self) -> Mapping[str, ArraySpec]:
        """Pictures, 8-bit RGB."""
        return {"images": ArraySpec((self.camera.height, self.camera.width, 3), np.uint8)}

    @cached_property
    def columns(self) -> Mapping[str, ndarray]:
        """Labels that are known without rendering."""
        shots = self.shots
        return {
            "pose": shots.pose,
            "split": shots.split.astype(np.int8),
            "condition": shots.condition.astype(np.int8),
            "scene": shots.scene.astype(np.int16),
            "place": shots.place.astype(np.int32),
        }

    @cached_property
    def facts(self) -> Mapping[str, Any]:
        """What the manifest says to a reader."""
        shots = self.shots
        counts = np.bincount(shots.split, minlength=len(self.splits))
        return {
            "image_size": [self.camera.width, self.camera.height],
            "rays_per_pixel": self.samples,
            "splits": dict(zip(self.splits, counts.tolist(), strict=True)),
            "conditions": self.condition_names,
            **self.describe(),
        }

    @property
    def splits(self) -> tuple[str, ...]:
        """Names of the splits, in the order of their numbers."""
        return SPLITS

    def render(self, start: int, stop: int) -> Mapping[str, ndarray]:
        """Pictures ``start`` to ``stop``; those of one scene and one light are cast together."""
        shots = self.shots
        keys = np.column_stack([shots.scene, shots.condition, shots.sun_turn_deg, shots.exposure_ev])[start:stop]
        change = np.flatnonzero(np.any(np.diff(keys, axis=0) != 0, axis=1)) + 1
        pictures = []
        for first, last in zip([0, *change], [*change, stop - start], strict=True):
            part = np.arange(start + first, start + last)
            renderer, appearance = self.view_of(start + int(first))
            poses = camera_poses(shots.pose[part])
            pictures.append(renderer.pictures(self.rays, poses, appearance, motions=shots.velocity[part], seeds=part))
        return {"images": np.concatenate(pictures)}

    def view_of(self, i: int) -> tuple[Renderer, Appearance]:
        """The renderer and the appearance of picture ``i``; renderers are kept while they are in use."""
        shots = self.shots
        scene, base = int(shots.scene[i]), self.appearances[shots.condition[i]]
        appearance = replace(
            base,
            sun_azimuth_deg=(base.sun_azimuth_deg + shots.sun_turn_deg[i] + 180) % 360 - 180,
            exposure_ev=base.exposure_ev + shots.exposure_ev[i],
        )
        return self._scenes.get((scene, appearance.structure), lambda: self.build(scene, appearance)), appearance


class _Held:
    """The last few renderers, each built once however many threads ask for it."""

    def __init__(self, most: int):
        self._most = most
        self._lock = threading.Lock()
        self._building: dict[Any, threading.Lock] = {}
        self._held: OrderedDict[Any, Renderer] = OrderedDict()

    def get(self, key: Any, build: Callable[[], Renderer]) -> Renderer:
        with self._lock:
            building = self._building.setdefault(key, threading.Lock())
        with building:
            with self._lock:
                if key in self._held:
                    self._held.move_to_end(key)
                    return self._held[key]
                while len(self._held) >= self._most:
                    self._held.popitem(last=False)
            renderer = build()
            with self._lock:
                self._held[key] = renderer
            return renderer


def camera_poses(pose: Float64[ndarray, "n 6"]) -> Float64[ndarray, "n 4 4"]:
    """World from camera for rows of x, y, z, heading, tilt, roll."""
    return level_camera_pose(*torch.from_numpy(np.ascontiguousarray(pose.T))).numpy()


def read_conditions(conditions: list[Any]) -> tuple[list[str], list[Appearance]]:
    """Names and appearances of a list such as ``["summer_noon", {"condition": "fog", "fog_per_m": 0.1}]``.

    Raises:
        UserError: a condition or factor does not exist, two have one name, or the list is empty.
    """
    names, looks = [], []
    for entry in conditions:
        if isinstance(entry, str):
            names.append(entry)
            looks.append(condition(entry))
        else:
            factors = dict(entry)
            base = str(factors.pop("condition", "summer_noon"))
            names.append(str(factors.pop("name", None) or "_".join([base, *map(str, factors)])))
            looks.append(with_factors(condition(base), factors))
    if not names:
        raise ArgumentError("conditions is empty", "Name at least one, say [summer_noon].")
    if len(set(names)) < len(names):
        raise ArgumentError(
            f"conditions has a duplicate name: {names}",
            "Give one of them another name: {name: ..., condition: ...}.",
        )
    return names, looks
