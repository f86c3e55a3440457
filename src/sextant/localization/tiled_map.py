"""Maps of any number of images, built from a stream in bounded memory: descriptors are never all in memory at once.

Images are written to a file as they come. Their descriptors are then sorted in
:func:`~sextant.localization.tiled_map.spatial_order`, a block at a time, and their neighbourhoods are prepared tile
by tile, each from its own images and a halo around them. The result is the folder of a map like any other,
:mod:`~sextant.localization.saved_map`, whose observations read only the tiles that poses need.

Memory holds one tile with its halo, and about 100 bytes per image while the poses are sorted. The disk holds the
descriptors twice until they are sorted. A builder on the folder of an interrupted one resumes after the images, blocks
and tiles that are done.
"""

import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.array_folder import plain_values
from sextant.atomic_files import read_json, write_atomically, write_json
from sextant.errors import UserError
from sextant.geometry.planar import wrap_angle
from sextant.localization.descriptor_map import BLOCK, DescriptorMap, check_pairs, mean_of_blocks
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation._caches import images_at_a_time, layout, prepared
from sextant.localization.observation.cached_local_gp import CachedLocalGP, MapEvidence
from sextant.localization.observation.neighbourhoods import Neighbourhoods, check_neighbours
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.saved_map import HEADER, array_path, write_header
from sextant.reporter import Advance
from sextant.shapes import check_shape
from sextant.tables import counted

#: Bits for the cells along the longer side of the map: cells of 1 mm in a map of 2,000 km.
BITS = 31


def spatial_order(poses: Float64[Tensor, "n 3"]) -> Int64[Tensor, " n"]:
    """Rows in Morton order (the Z-order curve) of their square cells on the ground; within a cell, by heading.

    A map stored in this order, as ``poses[rows]`` and ``descriptors[rows]``, is read in few pages when it is larger
    than memory and mapped, because images near each other are stored near each other.

    Raises:
        ArgumentError: poses are not rows of x, y and heading.
        ValueError: a pose is not finite.

    Source: G. M. Morton, "A computer oriented geodetic data base and a new technique in file sequencing", IBM 1966.

    Example:
        >>> corners = torch.tensor([[0.0, 0, 0], [9, 9, 0], [9, 0, 0], [0, 9, 0]], dtype=torch.float64)
        >>> corners[spatial_order(corners)][:, :2].tolist()  # a Z
        [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0], [9.0, 9.0]]
    """
    check_shape("poses", poses, "n", 3)
    places = poses.numpy()
    if not np.isfinite(places).all():
        raise ValueError("a pose is not finite")
    if len(places) == 0:
        return torch.zeros(0, dtype=torch.int64)
    corner = places[:, :2].min(axis=0)
    side = float((places[:, :2].max(axis=0) - corner).max()) or 1.0
    cells = ((places[:, :2] - corner) / side * (2**BITS - 1)).astype(np.uint64)
    codes = _spread(cells[:, 0]) | (_spread(cells[:, 1]) << np.uint64(1))
    return torch.from_numpy(np.lexsort((places[:, 2], codes)))


def _spread(values: np.ndarray) -> np.ndarray:
    """Spread the 32 bits of every value over the even bits of 64."""
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values


#: margin for the rounding of distances, both relative and absolute
SLACK = 1e-9


class Tiles:
    """Runs of consecutive images of a map, and the box of each on the ground in lengths of the kernel.

    Args:
        poses: poses of the map, best in spatial order; may be a mapped file.
        kernel: kernel whose features are compared.
        size: number of images in a tile; a last tile with fewer than ``least`` is merged into the one before.
        least: smallest number of images in a tile.
    """

    def __init__(self, poses: Float64[Tensor, "n 3"], kernel: PoseKernel, size: int, least: int):
        self.poses, self.kernel = poses, kernel
        count = max(1, len(poses) // size + (len(poses) % size >= least))
        self.ends = np.append(np.arange(count) * size, len(poses))
        boxes = [self._ground(start, stop) for start, stop in zip(self.ends[:-1], self.ends[1:], strict=True)]
        self._low = np.stack([ground.min(axis=0) for ground in boxes])
        self._high = np.stack([ground.max(axis=0) for ground in boxes])

    def __len__(self) -> int:
        return len(self.ends) - 1

    def rows(self, tile: int) -> Int64[Tensor, " m"]:
        """The images of a tile."""
        return torch.arange(int(self.ends[tile]), int(self.ends[tile + 1]))

    def neighbours(self, tile: int, k: int) -> Int64[Tensor, "m k"]:
        """The k nearest images of the whole map to each image of a tile, nearest first.

        The k nearest within the tile bound the distance of the k nearest of all. The halo is as wide as the widest of
        these bounds, so that nothing beyond it can be nearer.
        """
        own = self.rows(tile)
        features = self.kernel.features(self.poses[own]).numpy()
        bounds = cKDTree(features).query(features, k=[k])[0]
        reach = float(bounds.max()) * (1 + SLACK) + SLACK
        low, high = self._low[tile] - reach, self._high[tile] + reach
        near = np.flatnonzero(((self._low <= high) & (self._high >= low)).all(axis=1))
        candidates = torch.cat([self._within(int(other), low, high) for other in near])
        search = Neighbourhoods(self.poses[candidates], self.kernel)
        return candidates[search.of_images(torch.searchsorted(candidates, own), k).rows]

    def _within(self, tile: int, low: ndarray, high: ndarray) -> Tensor:
        start, stop = int(self.ends[tile]), int(self.ends[tile + 1])
        ground = self._ground(start, stop)
        return start + torch.from_numpy(np.flatnonzero(((ground >= low) & (ground <= high)).all(axis=1)))

    def _ground(self, start: int, stop: int) -> ndarray:
        ground: ndarray = self.kernel.features(self.poses[start:stop])[:, :2].numpy()
        return ground


#: number of images in a tile: 2 MiB for 128 values
TILE = 4096
PROGRESS, INCOMING = "building.json", "incoming"
FORMAT = "sextant.tiled_map_in_the_making"


class TiledMapBuilder:
    """Builds a map in a folder: images are added, then the map is finished.

    Args:
        folder: folder of the map, created if need be; that of an interrupted builder is resumed.

    Attributes:
        images: number of images added, including those by an interrupted builder; a stream resumes with the next one.

    Raises:
        UserError: the folder already holds a map, or its contents are not from a builder.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from sextant.localization.saved_map import load_map
        >>> line = torch.tensor([[float(x), 0.0, 0.0] for x in range(20)], dtype=torch.float64)
        >>> with TemporaryDirectory() as folder:
        ...     TiledMapBuilder(folder).add(line[:12], torch.eye(20)[:12])  # and is interrupted
        ...     builder = TiledMapBuilder(folder)
        ...     builder.add(line[builder.images :], torch.eye(20)[builder.images :])
        ...     builder.finish(PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1), Likelihood(), neighbours=4)
        ...     len(load_map(Path(folder)).model.map)
        20
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder).expanduser()
        if (self.folder / HEADER).is_file():
            raise UserError(f"{self.folder} already holds a map", "Delete it, or name another folder.")
        known = read_json(self.folder / PROGRESS)
        if known is None and (self.folder / PROGRESS).is_file():
            raise UserError(f"{self.folder / PROGRESS} is damaged", "Delete the folder and start again.")
        self._state: dict[str, Any] = known or {"format": FORMAT, "stage": "adding", "images": 0, "dimension": 0}
        if not isinstance(self._state, dict) or self._state.get("format") != FORMAT:
            raise UserError(f"{self.folder} does not hold a map being built", "Name another folder.")

    @property
    def images(self) -> int:
        """The number of images added; see the class."""
        return int(self._state["images"])

    def add(self, poses: Float64[Tensor, "m 3"], descriptors: Float32[Tensor, "m d"]) -> None:
        """Add the next images; when it returns, they are in the files of the folder.

        Args:
            poses: x, y in metres and heading in rad, in any order.
            descriptors: descriptors of the images there.

        Raises:
            UserError: poses or descriptors are not rows, or their numbers differ; a pose or descriptor is not finite,
                or of a different dimension from earlier ones; or the map is already being finished.
            OSError: the folder cannot be written.
        """
        if self._state["stage"] != "adding":
            raise UserError(f"the map in {self.folder} is being finished", "Call finish(), or start in another folder.")
        if len(poses) == len(descriptors) == 0:
            return
        poses, descriptors = poses.double(), descriptors.float()
        self._check(poses, descriptors)
        for name, array in (("poses", poses.numpy()), ("descriptors", descriptors.numpy())):
            self._append(name, np.ascontiguousarray(array))
        self._note(images=self.images + len(poses), dimension=descriptors.shape[1])

    def finish(
        self,
        kernel: PoseKernel,
        likelihood: Likelihood,
        *,
        neighbours: int = 16,
        blend: int = 1,
        map_evidence: MapEvidence = "image",
        tile: int = TILE,
        facts: dict[str, Any] | None = None,
        progress: Advance | None = None,
    ) -> None:
        """Sort the images, prepare their neighbourhoods, and turn the folder into a map.

        Args:
            kernel: kernel of the model once it is fitted.
            likelihood: see :func:`~sextant.localization.saved_map.save_map`.
            neighbours, blend, map_evidence, tile: arguments of the :class:`CachedLocalGP` that the map is opened as.
            facts: other facts that are kept with the map.
            progress: called with the number of images done in the current stage and of all.

        Raises:
            UserError: there is no image, two are at one pose, ``neighbours`` or ``blend`` is not between 1 and the
                number of images, or the covariance of neighbours is not positive definite.
            OSError: the folder cannot be written.
        """
        if not self.images:
            raise UserError("the map is empty: no image was added", "Call add(poses, descriptors) first.")
        for count in (neighbours, blend):
            check_neighbours(count, self.images)
        model, facts = CachedLocalGP(neighbours, blend, map_evidence, tile), plain_values(facts or {})
        neighbours, tile = int(neighbours), int(tile)
        if self._state["stage"] in ("adding", "sorting"):
            self._sort(progress)
        self._prepare(kernel, neighbours, tile, progress)
        shutil.rmtree(self.folder / INCOMING, ignore_errors=True)
        arrays = ["poses", "descriptors", "mean", *self._caches(kernel, neighbours)]
        write_header(self.folder, model, kernel, likelihood, facts, arrays)
        (self.folder / PROGRESS).unlink()

    # -- adding --------------------------------------------------------------------------------------------------------

    def _check(self, poses: Tensor, descriptors: Tensor) -> None:
        check_pairs(poses, descriptors)
        if self.images and descriptors.shape[1] != self._state["dimension"]:
            raise UserError(
                f"descriptors have {counted(descriptors.shape[1], 'value')}, but earlier ones have "
                f"{self._state['dimension']}",
                "Describe all images with the same descriptor.",
            )
        broken = ~(poses.isfinite().all(dim=1) & descriptors.isfinite().all(dim=1))
        if bool(broken.any()):
            row = self.images + int(broken.nonzero()[0])
            raise UserError(
                f"{counted(int(broken.sum()), 'image has', 'images have')} a pose or descriptor that is not finite, "
                f"the first of them image {row}, counted from 0",
                "Leave these images out.",
            )

    def _append(self, name: str, array: ndarray) -> None:
        """Write rows after the recorded ones; what an interrupted call left there is overwritten."""
        path = self._incoming(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("r+b" if path.is_file() else "wb") as file:
            file.seek(self.images * array.shape[1] * array.itemsize)
            file.truncate()
            array.tofile(file)

    def _incoming(self, name: str) -> Path:
        return self.folder / INCOMING / name

    def _note(self, **known: Any) -> None:
        self._state = {**self._state, **known}
        write_json(self.folder / PROGRESS, self._state)

    # -- sorting -------------------------------------------------------------------------------------------------------

    def _sort(self, progress: Advance | None) -> None:
        poses = torch.from_numpy(np.fromfile(self._incoming("poses"), np.float64, 3 * self.images).reshape(-1, 3))
        _refuse_repeated(poses)
        order = spatial_order(poses)
        shape = (self.images, int(self._state["dimension"]))
        if self._state["stage"] == "adding":
            sorted_poses = poses[order].numpy()
            write_atomically(array_path(self.folder, "poses"), partial(np.save, arr=sorted_poses, allow_pickle=False))
            _make_file(array_path(self.folder, "descriptors"), shape, np.float32)
            self._note(stage="sorting", sorted=0)
        for start in range(int(self._state["sorted"]), self.images, BLOCK):
            block = order[start : start + BLOCK]
            # reopened for each block, so that its pages are not held while the next ones are read
            come = np.memmap(self._incoming("descriptors"), np.float32, "r", shape=shape)
            self._write("descriptors", start, come[block.numpy()])
            self._note(sorted=start + len(block))
            if progress is not None:
                progress(start + len(block), self.images)
        mean = mean_of_blocks(self._descriptor_blocks()).numpy()
        write_atomically(array_path(self.folder, "mean"), partial(np.save, arr=mean, allow_pickle=False))
        self._note(stage="preparing", prepared=0)

    def _descriptor_blocks(self) -> Iterator[Tensor]:
        for start in range(0, self.images, BLOCK):
            yield torch.from_numpy(self._mapped("descriptors")[start : start + BLOCK].copy())

    def _mapped(self, name: str) -> ndarray:
        mapped: ndarray = np.load(array_path(self.folder, name), mmap_mode="r", allow_pickle=False)
        return mapped

    def _write(self, name: str, start: int, rows: ndarray) -> None:
        file = np.load(array_path(self.folder, name), mmap_mode="r+", allow_pickle=False)
        file[start : start + len(rows)] = rows
        file.flush()

    # -- preparing -----------------------------------------------------------------------------------------------------

    def _caches(self, kernel: PoseKernel, k: int) -> dict[str, tuple[tuple[int, ...], type[np.generic]]]:
        return {f"state/{name}": kind for name, kind in layout(self.images, k, kernel).items()}

    def _prepare(self, kernel: PoseKernel, k: int, size: int, progress: Advance | None) -> None:
        settings = plain_values({"kernel": asdict(kernel), "neighbours": k, "tile": size})
        if self._state.get("settings") != settings:  # not begun, or begun with other settings
            for name, (shape, dtype) in self._caches(kernel, k).items():
                _make_file(array_path(self.folder, name), shape, dtype)
            self._note(settings=settings, prepared=0)
        # copy-on-write, so that tensors can be made from it; unless written to, its pages are those of the file
        poses = torch.from_numpy(np.load(array_path(self.folder, "poses"), mmap_mode="c", allow_pickle=False))
        mean = torch.from_numpy(np.load(array_path(self.folder, "mean"), allow_pickle=False))
        tiles = Tiles(poses, kernel, size, least=k)
        for tile in range(int(self._state["prepared"]), len(tiles)):
            rows, neighbours = tiles.rows(tile), tiles.neighbours(tile, k)
            used = torch.unique(neighbours)
            near = DescriptorMap(poses[used], torch.from_numpy(self._mapped("descriptors")[used.numpy()]), mean)
            self._prepare_tile(near, kernel, rows, neighbours, used)
            self._note(prepared=tile + 1)
            if progress is not None:
                progress(int(rows[-1]) + 1, self.images)

    def _prepare_tile(
        self, near: DescriptorMap, kernel: PoseKernel, rows: Tensor, neighbours: Tensor, used: Tensor
    ) -> None:
        at_a_time = images_at_a_time(neighbours.shape[1], near.dimension)
        for some, of_some in zip(rows.split(at_a_time), neighbours.split(at_a_time), strict=True):
            among, own = torch.searchsorted(used, of_some), torch.searchsorted(used, some)
            found = prepared(near, kernel, among, own) | {"neighbours": of_some.int()}
            for name, values in found.items():
                self._write(f"state/{name}", int(some[0]), values.numpy())


def _make_file(path: Path, shape: tuple[int, ...], dtype: type[np.generic]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileNotFoundError):
        path.unlink()
    np.lib.format.open_memmap(path, mode="w+", dtype=dtype, shape=shape).flush()


def _refuse_repeated(poses: Float64[Tensor, "n 3"]) -> None:
    x, y, heading = poses[:, 0].numpy(), poses[:, 1].numpy(), wrap_angle(poses[:, 2]).numpy()
    order = np.lexsort((heading, y, x))
    alike = np.ones(len(order) - 1, dtype=bool)
    for column in (x, y, heading):
        ordered = column[order]
        alike &= ordered[1:] == ordered[:-1]
    if alike.any():
        first = int(np.flatnonzero(alike)[0])
        raise UserError(
            f"{counted(int(alike.sum()), 'image shares', 'images share')} a pose with another (same x, y and "
            f"heading), such as images {min(order[first], order[first + 1])} and "
            f"{max(order[first], order[first + 1])}, counted from 0",
            "Leave one of them out.",
        )
