"""Line detection and network prediction for photos, with doubts about the photo or its prediction."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from numpy import ndarray
from PIL import Image
from torch import Tensor

from sextant.applications.failures import FailedPhoto, attempted
from sextant.applications.pixels import rgb_pixels
from sextant.baselines.calibration import CameraBelief, LineEvidence
from sextant.chapters.calibration.finding import LEVELS, STUDENT, Doubt, Finding
from sextant.chapters.calibration.network import CameraNetwork
from sextant.chapters.calibration.other_networks import OtherNetwork
from sextant.data.photos import NetworkView, Photo, network_view, photo_of_array, read_photo
from sextant.data.photos.odd_pictures import check_no_panorama, closed_around, odd_picture
from sextant.data.picture_files import DECODE
from sextant.errors import UserError
from sextant.geometry import CameraParameters

#: photos per forward pass of the network
BATCH = 64
LITTLE_SEEN = 0.6  # of the photo's area
#: size of the small copy by which photos are compared where a network of others sees the whole
COPY = (64, 48)
MAYBE_PANORAMA = (
    "it is 2:1 and its left and right edges match, as in a 360° panorama, but they show too little detail to be certain"
)
#: receives the name and the pixels of each photo that is read
See = Callable[[str, UInt8[ndarray, "h w 3"]], None]
AnyPhoto = Path | str | UInt8[ndarray, "h w 3"] | Image.Image


@dataclass(frozen=True)
class _Seen:
    """A photo without its pixels, with its lines and the doubts about it."""

    name: str
    photo: Photo
    view: NetworkView
    lines: LineEvidence | None
    doubts: tuple[Doubt, ...]
    believed: CameraBelief | None = None


def find_cameras(
    network: CameraNetwork | OtherNetwork,
    photos: Iterable[tuple[str, AnyPhoto]],
    *,
    look_at_lines: bool = False,
    see: See | None = None,
) -> Iterator[Finding | FailedPhoto]:
    """The network's prediction for each photo, in their order.

    Photos are read one at a time, and only the reduced views and the lines are kept.

    Args:
        network: the trained network, or one of others.
        photos: photos with their names.
        look_at_lines: detect lines, refuse panoramas, and doubt pictures that may not be photos.
        see: is called with each photo's name and pixels.
    """
    if isinstance(network, OtherNetwork):
        for name, photo in photos:
            yield attempted(name, _found_by_others, network, name, photo, look_at_lines, see)
        return
    left = iter(photos)
    while batch := [
        attempted(name, _seen, network, name, photo, look_at_lines, see) for name, photo in islice(left, BATCH)
    ]:
        predicted = _predicted(network, [each.view for each in batch if not isinstance(each, FailedPhoto)])
        for each in batch:
            yield each if isinstance(each, FailedPhoto) else _finding(network, each, *next(predicted))


def _seen(
    network: CameraNetwork | OtherNetwork, name: str, photo: AnyPhoto, look_at_lines: bool, see: See | None
) -> _Seen:
    read = given_photo(name, photo)
    if look_at_lines:
        check_no_panorama(read.image, name)
    believed = None
    if isinstance(network, OtherNetwork):
        view = network_view(read, [read.width / read.height], *COPY)
        believed = network.believed(read.image, name)
    else:
        spec = network.spec
        view = network_view(read, spec.aspects, spec.width, spec.height, canvas=spec.canvas)
    lines = LineEvidence.of(np.ascontiguousarray(read.image)) if look_at_lines else None
    doubts = list[Doubt]()
    if look_at_lines:
        doubts += [Doubt(2, odd)] if (odd := odd_picture(read.image)) else []
        doubts += [Doubt(1, MAYBE_PANORAMA)] if closed_around(read.image) else []
    if read.cropped:
        cropped = "its shape differs from that in EXIF: if it was cropped, the optical axis may not be at its centre"
        doubts.append(Doubt(1, cropped))
    if see is not None:
        see(name, read.image)
    return _Seen(name, replace(read, image=np.zeros((0, 0, 3), np.uint8)), view, lines, tuple(doubts), believed)


def _found_by_others(
    network: OtherNetwork, name: str, photo: AnyPhoto, look_at_lines: bool, see: See | None
) -> Finding:
    """The finding of a network of others, which sees the whole photo."""
    seen = _seen(network, name, photo, look_at_lines, see)
    said = seen.believed
    assert said is not None
    numbers = (said.tilt, said.roll, said.focal, said.k1_hat * said.focal**2)
    camera = CameraParameters(*torch.tensor(numbers, dtype=torch.float64).unbind())
    half = {level: multiple * np.array(said.sigma) for level, multiple in STUDENT.items()}
    return Finding(
        name, seen.photo, seen.view, camera, half, "lopez", seen.doubts, "the network's spreads, Student's t",
        lines=seen.lines, of_others=True,
    )  # fmt: skip


def given_photo(
    name: str, photo: AnyPhoto, fix: str = "Give its file; for several photos use calibrate_many or one_camera."
) -> Photo:
    """A photo in any of the forms in which it may be given.

    Args:
        name: of an array or a Pillow image, for error messages.
        photo: the photo.
        fix: what to do about a photo of another type.

    Raises:
        UserError: it is none, cannot be read, or is smaller than 32 pixels per side.
    """
    if isinstance(photo, Path | str):
        return read_photo(Path(photo).expanduser())
    if isinstance(photo, Image.Image):
        photo = rgb_pixels(photo, name)
    if not isinstance(photo, ndarray):
        raise UserError(
            f"{name} is of type {type(photo).__name__}; a photo is a file, an array of RGB values from 0 to 255, "
            "or a Pillow image",
            DECODE if isinstance(photo, bytes | bytearray) else fix,
        )
    return photo_of_array(photo, name)


def _predicted(
    network: CameraNetwork, views: Sequence[NetworkView]
) -> Iterator[tuple[Tensor, dict[str, Float64[ndarray, "4"]], float]]:
    """For each view, the camera parameters, half-widths of their intervals by level, and the strangeness."""
    if not views:
        return
    images = torch.from_numpy(np.stack([view.image for view in views]).transpose(0, 3, 1, 2).copy())
    said = network.predict(images, torch.tensor([view.aspect for view in views], dtype=torch.float32))
    strange = torch.zeros(len(views)) if said.strangeness is None else said.strangeness.cpu()
    cameras = torch.stack(list(said.parameters), -1).cpu().double()
    half = {name: (said.scale * said.quantile(level)).cpu().double().numpy() for name, (level, _) in LEVELS.items()}
    for i, camera in enumerate(cameras):
        widths = {name: np.nan_to_num(each[i], nan=np.inf, posinf=np.inf) for name, each in half.items()}
        yield camera, widths, float(strange[i])


def _finding(
    network: CameraNetwork, seen: _Seen, numbers: Tensor, half: dict[str, Float64[ndarray, "4"]], strangeness: float
) -> Finding | FailedPhoto:
    spec, camera = network.spec, CameraParameters(*numbers.unbind())
    name, photo, view = seen.name, seen.photo, seen.view
    if not (numbers.isfinite().all() and camera.focal > 0 and camera.tilt.abs() < math.pi / 2):
        said = ", ".join(f"{n}={v:.3g}" for n, v in zip(camera._fields, numbers.tolist(), strict=True))
        return FailedPhoto(name, UserError(f"{name}: the network's prediction is not a valid camera ({said})"))
    doubts = list[Doubt]()
    if view.share < LITTLE_SEEN:
        covers = f"the network's input covers only {view.share:.0%} of the photo, whose shape is unusual"
        doubts.append(Doubt(1, covers, modelled=True))
    if view.width < spec.width or view.height < spec.height:
        used = f"of {photo.width}x{photo.height} pixels the network used {view.width:.0f}x{view.height:.0f}"
        doubts.append(Doubt(1, f"{used}, fewer than the {spec.width}x{spec.height} of its input"))
    if strangeness > 1:
        strange = (
            f"it does not resemble the network's training images: its distance from them is {strangeness:.1f} times "
            "the 95 % quantile of the validation images"
        )
        doubts.append(Doubt(1, strange, modelled=True))
    family = network.parameterization.k2_of_k1
    return Finding(
        name, photo, view, camera, half, family, seen.doubts, lines=seen.lines, strangeness=strangeness,
        network_doubts=tuple(doubts),
    )  # fmt: skip
