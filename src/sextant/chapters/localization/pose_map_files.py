"""Saved maps of posed photos: a folder of arrays with a sealed header, and the descriptor that chooses candidates."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.array_folder import FolderFormat, plain_values
from sextant.atomic_files import hash_file, write_atomically
from sextant.chapters.places.photo_features import extractor_of
from sextant.chapters.places.saved_descriptor import SavedDescriptor, load_descriptor
from sextant.correspondence import LocalFeatureExtractor, LocalFeatures, Pinhole, PosedMap, PoseErrors, XFeatures
from sextant.errors import ArgumentError

FORMAT = FolderFormat("a map of posed photos", "sextant pose map", 1, "pose_map.json")
DESCRIPTOR = "descriptor"
#: arrays that stay on the disk: nine tenths of a map
MAPPED: dict[str, Literal["r"]] = {"pixels": "r", "local_descriptors": "r"}


@dataclass(frozen=True, eq=False)
class SavedPoseMap:
    """All that is needed to open a map again.

    Attributes:
        posed: features, poses, cameras and points.
        names: of the images.
        described_by: what describes whole images.
        descriptors: of the images, of unit length.
        features: the local features.
        local: their name, by which they are made again; None: they are an object of the user.
    """

    posed: PosedMap
    names: Sequence[str]
    described_by: SavedDescriptor
    descriptors: Float32[ndarray, "n d"]
    features: LocalFeatureExtractor
    local: str | None


def save_pose_map(saved: SavedPoseMap, folder: Path) -> None:
    """Write a map; the header last, so that an interrupted write leaves none.

    Raises:
        OSError: the folder cannot be written.
    """
    posed = saved.posed
    options = {"keypoints": getattr(saved.features, "keypoints", None), "side": saved.features.side}
    header = plain_values(
        {
            "sha256": {},
            "names": list(saved.names),
            "features": {"name": saved.features.name, **options},
            "local": saved.local,
            "local_model": saved.features.model,
            "keypoints_of": [len(each) for each in posed.features],
            "pixel": [each.pixel for each in posed.features],
            "cameras": [asdict(each) for each in posed.cameras],
            "pixel_variance": posed.pixel_variance,
            "errors": asdict(posed.errors),
        }
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FORMAT.header).unlink(missing_ok=True)
    (folder / DESCRIPTOR).mkdir(exist_ok=True)
    saved.described_by.save(folder / DESCRIPTOR)
    arrays: dict[str, Sequence[ndarray]] = {
        "poses": [posed.poses],
        "points": [posed.points],
        "covariances": [posed.covariances.astype(np.float32)],
        "point_of": posed.point_of,
        "pixels": [each.points for each in posed.features],
        "local_descriptors": [each.descriptors for each in posed.features],
        "descriptors": [saved.descriptors],
    }
    for name, parts in arrays.items():
        path = folder / f"{name}.npy"
        write_atomically(path, lambda file, parts=parts: _write_parts(file, parts))  # type: ignore[misc]
        header["sha256"][name] = hash_file(path)
    FORMAT.write_header(folder, header)


def _write_parts(file: BinaryIO, parts: Sequence[ndarray]) -> None:
    """Write arrays as one, joined along the first axis, without a copy of all."""
    first = parts[0]
    shape = (sum(len(part) for part in parts), *first.shape[1:])
    described = {"descr": np.lib.format.dtype_to_descr(first.dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, described)
    for part in parts:
        file.write(np.ascontiguousarray(part, first.dtype).tobytes())


def open_pose_map(folder: Path, local: Any = None) -> SavedPoseMap:
    """Open a map that :func:`save_pose_map` wrote; local features are read from the disk when they are matched.

    Args:
        folder: that it was saved to.
        local: the local features or their name; None: as it was saved.

    Raises:
        UserError: it is not one, is damaged, or has other local features.
    """
    header = FORMAT.read_header(folder)
    try:
        posed, descriptors = _posed(folder, header)
        header = {**header, "names": list(header["names"]), "features": dict(header["features"])}
    except (ArgumentError, AttributeError, LookupError, TypeError, ValueError) as error:
        why = error.problem if isinstance(error, ArgumentError) else repr(error)
        raise FORMAT.damaged(folder, f"{FORMAT.header} cannot be used: {why}") from error
    described_by = load_descriptor(folder / DESCRIPTOR)
    local, extractor = _extractor(folder, header, local, described_by)
    posed = replace(posed, match=extractor.match)
    return SavedPoseMap(posed, header["names"], described_by, descriptors, extractor, local)


def _posed(folder: Path, header: dict[str, Any]) -> tuple[PosedMap, Float32[ndarray, "n d"]]:
    """The features, poses and points of a saved map, and the descriptors of its images."""
    arrays = {
        name: np.asarray(FORMAT.open_array(folder, folder / f"{name}.npy", MAPPED.get(name), sha256=sha256))
        for name, sha256 in header["sha256"].items()
    }
    ends = np.cumsum(header["keypoints_of"])[:-1]
    cameras = [Pinhole(**camera) for camera in header["cameras"]]
    pixels, described = (np.split(arrays[name], ends) for name in ("pixels", "local_descriptors"))
    features = [
        LocalFeatures(points, descriptors, camera.width, camera.height, pixel)
        for points, descriptors, camera, pixel in zip(pixels, described, cameras, header["pixel"], strict=True)
    ]
    if not len(header["names"]) == len(cameras) == len(arrays["poses"]) == len(arrays["descriptors"]):
        raise FORMAT.damaged(folder, "its images, names and cameras differ in number")
    point_of = np.split(arrays["point_of"], ends)
    factor = float(header.get("variance_factor", 1.0))  # maps of earlier versions have one factor, or none
    errors = PoseErrors(**header.get("errors", {"scale": factor, "focal": factor}))
    variance = float(header.get("pixel_variance", 1.0))
    covariances = arrays["covariances"].astype(np.float64)
    world = (arrays["poses"], cameras, arrays["points"], covariances, point_of)
    return PosedMap(features, *world, variance, errors), arrays["descriptors"]


def _extractor(
    folder: Path, header: dict[str, Any], local: Any, described_by: SavedDescriptor
) -> tuple[str | None, LocalFeatureExtractor]:
    """The name of a map's local features, and what extracts them.

    Raises:
        ArgumentError: they are others than those of the map, or those of the map are an object that is not given.
    """
    local = header.get("local", "xfeat") if local is None else local  # maps of earlier versions have XFeat's
    if local is None:
        raise ArgumentError(
            f"the map in {folder} has local features of an object: {header['features']['name']}",
            "Give it: PoseMap.open(folder, local=...).",
        )
    options = {key: value for key, value in header["features"].items() if key != "name"}
    extractor = extractor_of(local, described_by.describer, **options)
    model = header.get("local_model") or XFeatures(**options).model
    if extractor.model != model:
        raise ArgumentError(
            f"local={local} gives other local features ({extractor.model}) than those of the map in {folder} ({model})",
            "Leave out local, or make the map anew.",
        )
    return local if isinstance(local, str) else None, extractor
